/*
 * The serial line. Written by minorloop {{ version }}.
 *
 * A question is a line "7 SET {{ example }} *CRC32", its answer "7 OK {{ example }} *CRC32" or "7 ERR why *CRC32":
 *
 *     HELLO          minorloop 3 {{ count }} {{ count }} {{ lines | length }} {{ patience }}: protocol, inputs, outputs, lines, patience in ms
 *     INPUT k        unit, limits and safe value of input k, from 0
 *     OUTPUT k       unit of output k
 *     SET u ...      goals of all inputs, which go there as fast as their rate limits allow
 *     GET            readings of all sensors
 *     FOLLOW y ...   targets of all outputs, which the inverse of the models leads them to
 *     ON             inputs that are on now
 *     LINE k s       switch digital line k on, 1, or off, 0
 *     SAFE           go to the safe inputs; the answer has those that are on
 *
 * A line that is damaged, too long or not understood changes nothing. After {{ patience }} ms without a sound
 * line, the inputs go to their safe values and the lines to rest. Whoever had put an input on must
 * learn of that: from then on, and from power-up on, SET, GET and FOLLOW are refused with "ERR safe"
 * until HELLO or SAFE has been said.
 */
#ifndef PROTOCOL_H
#define PROTOCOL_H

void protocol_begin(void);       /* safe, and as after a loss of power */
void protocol_hear(char next);   /* the next character of the host */
void protocol_millisecond(void); /* call this once a millisecond */

#endif
