#ifndef START_H
#define START_H

#include <stdint.h>

void say(const char *text);
void say_number(uint32_t number);
void stop(int failed);
void work(void);

#endif
