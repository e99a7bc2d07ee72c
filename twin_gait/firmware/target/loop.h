/* The unit that runs, and the functions that the main loop needs from its machine: a Cortex-M4F or a host.
   UNIT, UNIT_RECORD, UNIT_INIT and UNIT_HEADER are defined on the command line, for example as exoskeleton,
   Exoskeleton, exoskeleton_init, "exoskeleton.h". */
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

/* Run a step and return its clock counts; 0 on a host, which has no such clock. */
uint32_t clocked(Step *step, Unit *unit, const Inputs *inputs, Outputs *outputs);

/* Mark the stack, and return the deepest stack since then in bytes; 0 on a host, which does not measure it. */
void mark_stack(void);
uint32_t stack_bytes(void);

#endif
