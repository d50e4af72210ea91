/* Numbers as text. Written by minorloop {{ version }}. */
#include "numbers.h"

#include <math.h>

#define MOST_DIGITS 18 /* that fit into 64 bits */
#define LARGEST_POWER 300
#define DIGITS 12
#define LOWEST 1e-300

static double power_of_ten(int32_t exponent)
{
    double power = 1.0;
    double base = 10.0;
    int32_t left = exponent;

    while (left > 0) {
        if ((left % 2) != 0) {
            power *= base;
        }
        base *= base;
        left /= 2;
    }
    return power;
}

/* Division keeps powers of ten exact as long as they can be. */
static double scaled(double value, int32_t exponent)
{
    return (exponent < 0) ? (value / power_of_ten(-exponent)) : (value * power_of_ten(exponent));
}

static int is_digit(char character)
{
    return (character >= '0') && (character <= '9');
}

/* The exponent after an e; the result is 0 if there is none. */
static int exponent_read(const char *text, int32_t *exponent)
{
    const int negative = text[0] == '-';
    const char *next = (negative || (text[0] == '+')) ? &text[1] : text;
    int32_t found = 0;
    const int given = is_digit(*next);

    while (is_digit(*next) && (found < 1000)) {
        found = 10 * found + (int32_t)(*next - '0');
        next = &next[1];
    }
    *exponent += negative ? -found : found;
    return given && (*next == '\0');
}

int number_read(const char *text, double *value)
{
    const int negative = text[0] == '-';
    const char *next = (negative || (text[0] == '+')) ? &text[1] : text;
    uint64_t digits = 0u;
    int32_t exponent = 0;
    int32_t count = 0;
    int point = 0;
    int good = 0;

    while (is_digit(*next) || ((*next == '.') && !point)) {
        if (*next == '.') {
            point = 1;
        } else {
            good = 1;
            if (count < MOST_DIGITS) {
                digits = 10u * digits + (uint64_t)(*next - '0');
                count += (digits > 0u) ? 1 : 0;
                exponent -= point ? 1 : 0;
            } else {
                exponent += point ? 0 : 1;
            }
        }
        next = &next[1];
    }
    if (good && ((*next == 'e') || (*next == 'E'))) {
        good = exponent_read(&next[1], &exponent);
    } else {
        good = good && (*next == '\0');
    }
    if (good && (digits > 0u) && ((exponent > LARGEST_POWER - 20) || (exponent < -LARGEST_POWER))) {
        good = 0;
    }
    if (good) {
        *value = scaled((double)digits, (digits > 0u) ? exponent : 0);
        *value = negative ? -*value : *value;
    }
    return good;
}

char *number_write_whole(char *text, uint32_t value)
{
    char digits[10];
    uint32_t left = value;
    uint32_t count = 0u;
    char *next = text;

    do {
        digits[count] = (char)('0' + (char)(left % 10u));
        count += 1u;
        left /= 10u;
    } while (left > 0u);
    while (count > 0u) {
        count -= 1u;
        *next = digits[count];
        next = &next[1];
    }
    *next = '\0';
    return next;
}

/* The exponent of ten of a positive number, and its first digits as a whole number. */
static uint64_t digits_of(double value, int32_t *exponent)
{
    const double least = power_of_ten(DIGITS - 1);
    int32_t found = (int32_t)floor(log10(value));
    double digits = floor(scaled(value, DIGITS - 1 - found) + 0.5);

    if (digits < least) {
        found -= 1;
        digits = floor(scaled(value, DIGITS - 1 - found) + 0.5);
    } else if (digits >= 10.0 * least) {
        found += 1;
        digits = floor(digits / 10.0 + 0.5);
    } else {
        /* as it is */
    }
    *exponent = found;
    return (uint64_t)digits;
}

char *number_write(char *text, double value)
{
    const double size = fabs(value);
    char *next = text;
    uint64_t digits;
    int32_t exponent;
    int32_t k;

    if (!isfinite(value)) {
        next[0] = 'n';
        next[1] = 'a';
        next[2] = 'n';
        next[3] = '\0';
        return &next[3];
    }
    if (size < LOWEST) {
        return number_write_whole(next, 0u);
    }
    digits = digits_of(size, &exponent);
    if (value < 0.0) {
        *next = '-';
        next = &next[1];
    }
    for (k = DIGITS; k > 0; --k) { /* the point is after the first digit */
        next[(k > 1) ? k : 0] = (char)('0' + (char)(digits % 10u));
        digits /= 10u;
    }
    next[1] = '.';
    next[DIGITS + 1] = 'e';
    next[DIGITS + 2] = (exponent < 0) ? '-' : '+';
    return number_write_whole(&next[DIGITS + 3], (uint32_t)((exponent < 0) ? -exponent : exponent));
}
