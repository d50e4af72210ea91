/* The serial line. Written by minorloop {{ version }}. */
#include "protocol.h"

#include "control.h"
#include "hal.h"
#include "numbers.h"

#include <string.h>

#define PATIENCE {{ patience }}u /* milliseconds */
#define LINES {{ lines | length }}u
#define LINE_LENGTH 160
#define ANSWER_LENGTH 200
#define MOST_WORDS 6u

static const char *const input_words[AXES] = {
{%- for axis in axes %}
    "{{ axis.input_unit }} {{ axis.low }} {{ axis.high }} {{ axis.rest }}",
{%- endfor %}
};
static const char *const output_words[AXES] = { {%- for axis in axes %}"{{ axis.output_unit }}"{% if not loop.last %}, {% endif %}{% endfor -%} };
{%- if lines %}
static const int line_rest[LINES] = { {%- for name, rest in lines %}{{ rest | int }}{% if not loop.last %}, {% endif %}{% endfor -%} };
{%- endif %}

typedef struct {
    char text[ANSWER_LENGTH];
    char *end;
} answer_t;

static char line[LINE_LENGTH + 1];
static uint32_t length;
static uint32_t silence; /* milliseconds since the last sound line */
static int on;           /* an input was put on since the last SAFE */
static int lost;         /* and it was taken off, by silence or by a loss of power */

static uint32_t crc32(const char *text, const char *end)
{
    uint32_t sum = 0xFFFFFFFFu;
    const char *next;
    int bit;

    for (next = text; next < end; next = &next[1]) {
        sum ^= (uint32_t)(unsigned char)*next;
        for (bit = 0; bit < 8; ++bit) {
            sum = ((sum & 1u) != 0u) ? ((sum >> 1) ^ 0xEDB88320u) : (sum >> 1);
        }
    }
    return ~sum;
}

static void sum_write(char *text, uint32_t sum)
{
    int k;

    for (k = 0; k < 8; ++k) {
        text[k] = "0123456789ABCDEF"[(sum >> (28 - 4 * k)) & 15u];
    }
    text[8] = '\0';
}

static void add(answer_t *answer, const char *words)
{
    while (*words != '\0') {
        *answer->end = *words;
        answer->end = &answer->end[1];
        words = &words[1];
    }
    *answer->end = ' ';
    answer->end = &answer->end[1];
}

static void add_whole(answer_t *answer, uint32_t value)
{
    char word[NUMBER_LENGTH];

    (void)number_write_whole(word, value);
    add(answer, word);
}

static void add_numbers(answer_t *answer, const double values[AXES])
{
    char word[NUMBER_LENGTH];
    uint32_t k;

    for (k = 0u; k < AXES; ++k) {
        (void)number_write(word, values[k]);
        add(answer, word);
    }
}

static void send(answer_t *answer)
{
    const uint32_t sum = crc32(answer->text, answer->end);

    *answer->end = '*';
    sum_write(&answer->end[1], sum);
    answer->end = &answer->end[9];
    answer->end[0] = '\n';
    answer->end[1] = '\0';
    hal_send(answer->text);
}

static void go_safe(void)
{
{%- if lines %}
    uint32_t k;

{% endif %}
    control_safe();
{%- if lines %}
    for (k = 0u; k < LINES; ++k) {
        hal_switch(k, line_rest[k]);
    }
{%- endif %}
}

/* A word as a place below a count; the count if it is none. */
static uint32_t place(const char *word, uint32_t count)
{
    const uint32_t found = (uint32_t)(word[0] - '0');

    return ((word[0] >= '0') && (word[1] == '\0') && (found < count)) ? found : count;
}

static int is(const char *word, const char *other, uint32_t words, uint32_t wanted)
{
    return (words == wanted) && (strcmp(word, other) == 0);
}

/* Set goals, or follow targets; return why not, or NULL. */
static const char *move(char *const words[], int follow)
{
    double values[AXES];
    const char *why = NULL;
    uint32_t k;

    for (k = 0u; k < AXES; ++k) {
        if (!number_read(words[k], &values[k])) {
            return "that is no number";
        }
    }
    if (follow) {
        why = control_follow(values) ? NULL : "out of reach";
    } else {
        why = control_set(values) ? NULL : "beyond the limits";
    }
    on = (why == NULL) ? 1 : on;
    return why;
}

/* Read all sensors; return why not, or NULL. */
static const char *readings(double values[AXES])
{
    uint32_t k;

    for (k = 0u; k < AXES; ++k) {
        if (!hal_get(k, &values[k])) {
            return "no reading";
        }
    }
    return NULL;
}

/* Carry out a command and add the words of its answer; return why not, or NULL. */
static const char *obey(answer_t *answer, char *const words[], uint32_t count)
{
    const char *const command = words[0];
    const char *why = NULL;
    double values[AXES];
    const int is_set = is(command, "SET", count, AXES + 1u);
    const int is_follow = is(command, "FOLLOW", count, AXES + 1u);
    const int is_get = is(command, "GET", count, 1u);

    if (is(command, "HELLO", count, 1u)) {
        lost = 0;
        add(answer, "minorloop 3 {{ count }} {{ count }} {{ lines | length }} {{ patience }}");
    } else if ((lost != 0) && (is_set || is_follow || is_get)) {
        why = "safe";
    } else if (is_set || is_follow) {
        why = move(&words[1], is_follow);
        if (why == NULL) {
            control_wanted(values);
            add_numbers(answer, values);
        }
    } else if (is_get) {
        why = readings(values);
        if (why == NULL) {
            add_numbers(answer, values);
        }
    } else if (is(command, "ON", count, 1u)) {
        control_on(values);
        add_numbers(answer, values);
    } else if (is(command, "SAFE", count, 1u)) {
        go_safe();
        on = 0;
        lost = 0;
        control_on(values);
        add_numbers(answer, values);
    } else if (is(command, "INPUT", count, 2u) && (place(words[1], AXES) < AXES)) {
        add(answer, input_words[place(words[1], AXES)]);
    } else if (is(command, "OUTPUT", count, 2u) && (place(words[1], AXES) < AXES)) {
        add(answer, output_words[place(words[1], AXES)]);
{%- if lines %}
    } else if (is(command, "LINE", count, 3u) && (place(words[1], LINES) < LINES)
               && (place(words[2], 2u) < 2u)) {
        hal_switch(place(words[1], LINES), (int)place(words[2], 2u));
        add(answer, words[2]);
{%- endif %}
    } else {
        why = "unknown command";
    }
    return why;
}

/* Cut a text at its spaces; return the number of words, or 0 if there are too many. */
static uint32_t split(char *text, char *words[MOST_WORDS])
{
    uint32_t count = 0u;
    char *next = text;

    while ((next != NULL) && (count < MOST_WORDS)) {
        words[count] = next;
        count += 1u;
        next = strchr(next, ' ');
        if (next != NULL) {
            *next = '\0';
            next = &next[1];
        }
    }
    return (next == NULL) ? count : 0u;
}

/* A line counts if its sum is right and it has a number and a command. */
static void understand(void)
{
    char *const star = strrchr(line, '*');
    char *words[MOST_WORDS];
    char sum[9];
    double sequence;
    uint32_t count;
    answer_t answer;
    answer_t refusal;
    const char *why;

    if ((star == NULL) || (star == line) || (star[-1] != ' ')) {
        return;
    }
    sum_write(sum, crc32(line, star));
    if (strcmp(sum, &star[1]) != 0) {
        return;
    }
    star[-1] = '\0';
    count = split(line, words);
    if ((count < 2u) || (strlen(words[0]) > 5u) || !number_read(words[0], &sequence)
        || (sequence < 0.0)) {
        return;
    }
    silence = 0u;
    answer.end = answer.text;
    refusal.end = refusal.text;
    add_whole(&answer, (uint32_t)sequence);
    add(&answer, "OK");
    why = obey(&answer, &words[1], count - 1u);
    if (why == NULL) {
        send(&answer);
    } else {
        add_whole(&refusal, (uint32_t)sequence);
        add(&refusal, "ERR");
        add(&refusal, why);
        send(&refusal);
    }
}

void protocol_begin(void)
{
    go_safe();
    on = 0;
    lost = 1;
    length = 0u;
    silence = 0u;
}

void protocol_hear(char next)
{
    if (next == '\n') {
        line[(length < LINE_LENGTH) ? length : 0u] = '\0';
        length = 0u;
        understand();
    } else if ((next != '\r') && (next != '\0') && (length < LINE_LENGTH)) {
        line[length] = next;
        length += 1u;
    } else {
        /* too long, or of no use */
    }
}

void protocol_millisecond(void)
{
    silence += 1u;
    if (silence > PATIENCE) {
        go_safe();
        lost = ((lost != 0) || (on != 0)) ? 1 : 0;
        on = 0;
        silence = 0u;
    }
}
