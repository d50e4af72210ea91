/* Numbers as text, without printf, which would allocate memory. Written by minorloop {{ version }}. */
#ifndef NUMBERS_H
#define NUMBERS_H

#include <stdint.h>

#define NUMBER_LENGTH 24 /* characters of the longest number, and the end of the text */

/* The number that fills a text; the result is 0 if there is none, or it is not finite. */
int number_read(const char *text, double *value);

/* Write a number with 12 digits, and return the end of the text. */
char *number_write(char *text, double value);

/* Write a whole number, and return the end of the text. */
char *number_write_whole(char *text, uint32_t value);

#endif
