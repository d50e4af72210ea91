/*
 * The Arm MPS2 board with a Cortex-M4 (AN386), and its emulator. Written by minorloop {{ version }}.
 *
 * UART 0 goes to the host. This board has no converters for currents and angles: UART 1 carries
 * them. The board sends "u ... lines" whenever they change and every 20 ms, numbers as text, the
 * lines as one whole number with a bit for each; the answer is the readings of all sensors. On a
 * board with converters, replace hal_set, hal_get and hal_switch.
 */
#include "control.h"
#include "hal.h"
#include "numbers.h"

#define CLOCK 25000000u
#define BAUD_DIVISOR (CLOCK / 115200u)
#define BEAT 20u        /* milliseconds */
#ifndef STALE
#define STALE 200u      /* milliseconds after which a reading is none */
#endif
#define GUARD 500u      /* milliseconds after which the watchdog timer resets the board */
#define RECEIVED 512u   /* characters, a power of two */
#define READING_LENGTH 100

typedef struct {
    volatile uint32_t data;
    volatile uint32_t state; /* bit 0: nothing more can be sent now; bit 1: received */
    volatile uint32_t control;
    volatile uint32_t interrupt;
    volatile uint32_t divisor;
} uart_t;

#define HOST ((uart_t *)0x40004000u)
#define SENSOR ((uart_t *)0x40005000u)
#define WATCHDOG_LOAD (*(volatile uint32_t *)0x40008000u)
#define WATCHDOG_CONTROL (*(volatile uint32_t *)0x40008008u)
#define WATCHDOG_CLEAR (*(volatile uint32_t *)0x4000800Cu)
#define WATCHDOG_LOCK (*(volatile uint32_t *)0x40008C00u)
#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018u)
#define INTERRUPTS (*(volatile uint32_t *)0xE000E100u)

void systick_interrupt(void);
void host_interrupt(void);
void sensor_interrupt(void);

typedef struct {
    volatile char text[RECEIVED];
    volatile uint32_t in;
    volatile uint32_t out;
} queue_t;

static volatile uint32_t milliseconds;
static queue_t host_queue;
static queue_t sensor_queue;
static double inputs[AXES];
static double outputs[AXES];
static uint32_t lines;
static int changed;
static uint32_t sent;    /* when the inputs were sent */
static uint32_t seen;    /* when the outputs came */
static int known;        /* outputs have come */
static char reading[READING_LENGTH + 1];
static uint32_t length;

/* The interrupt is cleared first: reading makes room for the next character, and its interrupt.
 * What arrives when the queue is full is lost; the sum of its line shows it. */
static void take(uart_t *port, queue_t *queue)
{
    char next;

    port->interrupt = 2u;
    next = (char)port->data;
    if ((queue->in - queue->out) < RECEIVED) {
        queue->text[queue->in % RECEIVED] = next;
        queue->in += 1u;
    }
}

static int32_t taken(queue_t *queue)
{
    int32_t next = -1;

    if (queue->in != queue->out) {
        next = (int32_t)(unsigned char)queue->text[queue->out % RECEIVED];
        queue->out += 1u;
    }
    return next;
}

void systick_interrupt(void)
{
    milliseconds += 1u;
}

void host_interrupt(void)
{
    take(HOST, &host_queue);
}

void sensor_interrupt(void)
{
    take(SENSOR, &sensor_queue);
}

static void put(uart_t *port, const char *text)
{
    while (*text != '\0') {
        while ((port->state & 1u) != 0u) {
        }
        port->data = (uint32_t)(unsigned char)*text;
        text = &text[1];
    }
}

static void begin_port(uart_t *port)
{
    port->divisor = BAUD_DIVISOR;
    port->control = 1u | 2u | 8u; /* send, receive, interrupt when received */
}

/* The readings of a line, if there is one for each sensor. */
static void read_line(void)
{
    double found[AXES];
    char *word = reading;
    uint32_t k;
    uint32_t count = 0u;

    for (k = 0u; k < AXES; ++k) {
        char *end = word;

        while ((*end != ' ') && (*end != '\0')) {
            end = &end[1];
        }
        const int last = *end == '\0';
        *end = '\0';
        count += number_read(word, &found[k]) ? 1u : 0u;
        word = last ? end : &end[1];
    }
    if ((count == AXES) && (*word == '\0')) {
        for (k = 0u; k < AXES; ++k) {
            outputs[k] = found[k];
        }
        known = 1;
        seen = milliseconds;
    }
}

static void hear_sensors(void)
{
    int32_t next = taken(&sensor_queue);

    while (next >= 0) {
        if (next == (int32_t)'\n') {
            reading[(length < READING_LENGTH) ? length : 0u] = '\0';
            length = 0u;
            read_line();
        } else if (length < READING_LENGTH) {
            reading[length] = (char)next;
            length += 1u;
        } else {
            /* too long */
        }
        next = taken(&sensor_queue);
    }
}

static void send_inputs(void)
{
    char text[(AXES + 1u) * NUMBER_LENGTH];
    char *end = text;
    uint32_t k;

    for (k = 0u; k < AXES; ++k) {
        end = number_write(end, inputs[k]);
        *end = ' ';
        end = &end[1];
    }
    end = number_write_whole(end, lines);
    end[0] = '\n';
    end[1] = '\0';
    put(SENSOR, text);
    changed = 0;
    sent = milliseconds;
}

void hal_begin(void)
{
    begin_port(HOST);
    begin_port(SENSOR);
    INTERRUPTS = 1u | 4u;
    SYSTICK_RELOAD = CLOCK / 1000u - 1u;
    SYSTICK_VALUE = 0u;
    SYSTICK_CONTROL = 7u;
    WATCHDOG_LOCK = 0x1ACCE551u;
    WATCHDOG_LOAD = CLOCK / 1000u * GUARD / 2u; /* the first time-out interrupts, the second resets */
    WATCHDOG_CONTROL = 3u;
}

uint32_t hal_milliseconds(void)
{
    return milliseconds;
}

int32_t hal_receive(void)
{
    return taken(&host_queue);
}

void hal_send(const char *text)
{
    put(HOST, text);
}

void hal_set(uint32_t input, double value)
{
    changed = (changed != 0) || (inputs[input] != value);
    inputs[input] = value;
}

int hal_get(uint32_t output, double *value)
{
    *value = outputs[output];
    return known && ((milliseconds - seen) <= STALE);
}

void hal_switch(uint32_t line, int on)
{
    const uint32_t bit = 1u << line;
    const uint32_t wanted = (on != 0) ? (lines | bit) : (lines & ~bit);

    changed = (changed != 0) || (wanted != lines);
    lines = wanted;
}

void hal_alive(void)
{
    WATCHDOG_CLEAR = 1u;
    hear_sensors();
    if ((changed != 0) || ((milliseconds - sent) >= BEAT)) {
        send_inputs();
    }
}

/* An interrupt that comes between the question and the sleep wakes the processor too. */
void hal_wait(void)
{
    __asm__ volatile("cpsid i");
    if (host_queue.in == host_queue.out) {
        __asm__ volatile("wfi");
    }
    __asm__ volatile("cpsie i");
}
