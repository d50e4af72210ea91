/* A board with the exported firmware as a process, whose sensor sees the input that is on.
   Lines come and go as of a port; each input that is put on is written as an error.
   Its clock stands still unless CLOCK is defined, and an at-sign puts it on. */
#define _POSIX_C_SOURCE 199309L
#include "minorloop.h"
#include <stdio.h>
#include <time.h>
int32_t board_receive(void);
void board_send(const char *text);
uint32_t board_milliseconds(void);
void board_set(minorloop_real u);
minorloop_real board_get(void);
void firmware_begin(void);
void firmware_poll(void);
static minorloop_real input;
static uint32_t late;
static int ended;
int32_t board_receive(void)
{
    const int next = getchar();
    ended = next == EOF;
    late += (next == '@') ? 1200u : 0u;
    return (ended || (next == '@')) ? -1 : (int32_t)next;
}
void board_send(const char *text)
{
    (void)fputs(text, stdout);
    (void)fflush(stdout);
}
uint32_t board_milliseconds(void)
{
    struct timespec now = {0, 0};
#ifdef CLOCK
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
#endif
    return late + (uint32_t)(1000 * (long)now.tv_sec + (long)(now.tv_nsec / 1000000));
}
void board_set(minorloop_real u)
{
    input = u;
    (void)fprintf(stderr, "%.9g\n", (double)u);
}
minorloop_real board_get(void) { return input; }
int main(void)
{
    firmware_begin();
    while (!ended) { firmware_poll(); }
    return 0;
}
