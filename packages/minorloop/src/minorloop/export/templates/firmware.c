/*
 * Sketch of firmware around {{ name }}.c: one input, one sensor, one serial line.
 * Written by minorloop {{ version }}. Fill in the five functions of the board below and call
 * firmware_poll as often as you can; compiled with -D{{ guard }}_HOST it talks on stdin and stdout
 * instead, with the model for an actuator.
 *
 * The lines are those of minorloop.lab.drivers.serial_line: "7 SET 0.25 *CRC32" is answered by
 * "7 OK 0.25 *CRC32". A line that is damaged, too long or not understood changes nothing. When no
 * sound line has come for {{ guard }}_PATIENCE_MS, the input goes to {{ guard }}_SAFE. Whoever had put
 * one on must learn of that: from then on, and from power-up on, SET and GET are refused with
 * "ERR safe" until HELLO or SAFE has been said.
 */
#include "{{ name }}.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define {{ guard }}_SAFE {{ safe }}
#ifndef {{ guard }}_PATIENCE_MS
#define {{ guard }}_PATIENCE_MS 1000u
#endif
#define LINE_MAX_LENGTH 120

int32_t board_receive(void);          /* the next character, or -1 */
void board_send(const char *text);    /* characters to the line */
uint32_t board_milliseconds(void);    /* a clock that may wrap around */
void board_set({{ name }}_real u);    /* put the input on */
{{ name }}_real board_get(void);      /* read the sensor */
void firmware_begin(void);
void firmware_poll(void);

static {{ name }}_state model;
static char line[LINE_MAX_LENGTH + 1];
static size_t length;
static uint32_t heard;
static int on;   /* an input was put on since the last SAFE */
static int lost; /* and it was taken off, by the watchdog or by a loss of power */

static uint32_t crc32(const char *text, size_t count)
{
    uint32_t sum = 0xFFFFFFFFu;
    size_t k;
    int bit;

    for (k = 0; k < count; ++k) {
        sum ^= (uint32_t)(unsigned char)text[k];
        for (bit = 0; bit < 8; ++bit) {
            sum = ((sum & 1u) != 0u) ? ((sum >> 1) ^ 0xEDB88320u) : (sum >> 1);
        }
    }
    return ~sum;
}

static void answer(unsigned long sequence, const char *words)
{
    char body[LINE_MAX_LENGTH + 1];
    char sum[16];

    (void)snprintf(body, sizeof body, "%lu %s ", sequence, words);
    (void)snprintf(sum, sizeof sum, "*%08lX\n", (unsigned long)crc32(body, strlen(body)));
    board_send(body);
    board_send(sum);
}

static void answer_number(unsigned long sequence, double value)
{
    char words[40];

    (void)snprintf(words, sizeof words, "OK %.17g", value);
    answer(sequence, words);
}

/* The whole of a text as a finite number. */
static int as_number(const char *text, {{ name }}_real *value)
{
    char *end = NULL;
    const double found = strtod(text, &end);

    *value = ({{ name }}_real)found;
    return (end != text) && (*end == '\0') && isfinite(*value);
}

static void obey(unsigned long sequence, const char *command, const char *argument)
{
    const int given = argument[0] != '\0';
    {{ name }}_real value = 0;
    char words[96];

    if (given && !as_number(argument, &value)) {
        answer(sequence, "ERR that is no number");
    } else if (!given && (strcmp(command, "HELLO") == 0)) {
        lost = 0;
        (void)snprintf(words, sizeof words, "OK minorloop 2 %.17g %.17g %lu",
                       (double){{ guard }}_INPUT_LOW, (double){{ guard }}_INPUT_HIGH,
                       (unsigned long){{ guard }}_PATIENCE_MS);
        answer(sequence, words);
    } else if ((lost != 0) && ((strcmp(command, "SET") == 0) || (strcmp(command, "GET") == 0))) {
        answer(sequence, "ERR safe");
    } else if (given && (strcmp(command, "SET") == 0)) {
        if ((value < {{ guard }}_INPUT_LOW) || (value > {{ guard }}_INPUT_HIGH)) {
            answer(sequence, "ERR beyond the limits");
        } else {
            board_set(value);
            on = 1;
            answer_number(sequence, (double)value);
        }
    } else if (!given && (strcmp(command, "GET") == 0)) {
        answer_number(sequence, (double)board_get());
    } else if (given && (strcmp(command, "STEP") == 0)) {
        answer_number(sequence, (double){{ name }}_step(&model, value));
{%- if inverse %}
    } else if (given && (strcmp(command, "AIM") == 0)) {
        answer_number(sequence, (double){{ name }}_aim(&model, value));
{%- endif %}
    } else if (!given && (strcmp(command, "SAFE") == 0)) {
        board_set({{ guard }}_SAFE);
        on = 0;
        lost = 0;
        answer(sequence, "OK");
    } else {
        answer(sequence, "ERR unknown command");
    }
}

/* A line counts if its sum is right and it has a number, a command and at most one argument. */
static void understand(void)
{
    char *const star = strrchr(line, '*');
    char *end = NULL;
    char *command;
    char *argument;
    unsigned long sequence;
    char sum[9];

    if ((star == NULL) || (star == line) || (star[-1] != ' ') || (strlen(star) != 9u)) {
        return;
    }
    (void)snprintf(sum, sizeof sum, "%08lX", (unsigned long)crc32(line, (size_t)(star - line)));
    if (strcmp(sum, &star[1]) != 0) {
        return;
    }
    star[-1] = '\0';
    sequence = strtoul(line, &end, 10);
    if ((end == line) || (*end != ' ') || (line[0] < '0') || (line[0] > '9')) {
        return;
    }
    heard = board_milliseconds();
    command = &end[1];
    argument = strchr(command, ' ');
    if (argument == NULL) {
        argument = &command[strlen(command)];
    } else {
        *argument = '\0';
        argument = &argument[1];
    }
    obey(sequence, command, argument);
}

void firmware_begin(void)
{
    {{ name }}_reset(&model);
    board_set({{ guard }}_SAFE);
    on = 0;
    lost = 1;
    length = 0;
    heard = board_milliseconds();
}

void firmware_poll(void)
{
    const int32_t next = board_receive();

    if (next == (int32_t)'\n') {
        line[(length < LINE_MAX_LENGTH) ? length : 0u] = '\0';
        length = 0;
        understand();
    } else if ((next > 0) && (next != (int32_t)'\r')) {
        if (length < LINE_MAX_LENGTH) {
            line[length] = (char)next;
            length += 1u;
        }
    } else {
        /* nothing came */
    }
    if ((uint32_t)(board_milliseconds() - heard) > {{ guard }}_PATIENCE_MS) {
        board_set({{ guard }}_SAFE);
        lost = ((lost != 0) || (on != 0)) ? 1 : 0;
        on = 0;
        heard = board_milliseconds();
    }
}

#ifdef {{ guard }}_HOST
static {{ name }}_state actuator;
static int ended;
static uint32_t ticks;

int32_t board_receive(void)
{
    const int next = getchar();

    ended = next == EOF;
    return ended ? -1 : (int32_t)next;
}

void board_send(const char *text)
{
    (void)fputs(text, stdout);
    (void)fflush(stdout);
}

uint32_t board_milliseconds(void)
{
    return ticks;
}

void board_set({{ name }}_real u)
{
    (void){{ name }}_step(&actuator, u);
}

{{ name }}_real board_get(void)
{
    return {{ name }}_output(&actuator);
}

int main(void)
{
    {{ name }}_reset(&actuator);
    firmware_begin();
    while (!ended) {
        firmware_poll();
    }
    return 0;
}
#endif
