/* The main loop. Written by minorloop {{ version }}. */
#include "control.h"
#include "hal.h"
#include "protocol.h"

int main(void);

int main(void)
{
    uint32_t done;
    int32_t next;

    hal_begin();
    control_begin();
    protocol_begin();
    done = hal_milliseconds();
    for (;;) {
        while (done != hal_milliseconds()) {
            done += 1u;
            protocol_millisecond();
            control_millisecond();
            hal_alive();
        }
        next = hal_receive();
        while (next >= 0) {
            protocol_hear((char)next);
            next = hal_receive();
        }
        hal_wait();
    }
}
