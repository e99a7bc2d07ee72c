/* The unit that runs, and what the main loop asks of the machine below it: a Cortex-M4F or a host.
   UNIT, UNIT_RECORD, UNIT_INIT and UNIT_HEADER come from the command line: exoskeleton, Exoskeleton,
   exoskeleton_init, "exoskeleton.h". */
#ifndef LOOP_H
#define LOOP_H

#include <stdbool.h>
#include <stdint.h>

#include UNIT_HEADER

#define PASTE(a, b) a##b
#define JOIN(a, b) PASTE(a, b)
#define unit_init UNIT_INIT
#define unit_step JOIN(UNIT, _step)

typedef UNIT_RECORD Unit;
typedef JOIN(UNIT_RECORD, Inputs) Inputs;
typedef JOIN(UNIT_RECORD, Outputs) Outputs;
typedef void Step(Unit *, const Inputs *, Outputs *);

enum { CALIBRATION = 3 }; /* clock counts of steps of 1, 1002 and 100002 instructions */

void open_channel(uint32_t calibration[CALIBRATION]);
bool receive(void *bytes, uint32_t size); /* false at the end of the stream */
void transmit(const void *bytes, uint32_t size);

/* Run a step; the clock counts that it took. A host has no such clock: 0. */
uint32_t clocked(Step *step, Unit *unit, const Inputs *inputs, Outputs *outputs);

/* The deepest stack since it was marked, in bytes. A host does not know: 0. */
void mark_stack(void);
uint32_t stack_bytes(void);

#endif
