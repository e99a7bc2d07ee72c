/* Machine of the main loop: a host with standard input and output, without a clock of instructions. */
#include <stdio.h>
#include <stdlib.h>

#include "loop.h"

void open_channel(uint32_t calibration[CALIBRATION]) { (void)calibration; }

bool receive(void *bytes, uint32_t size) { return fread(bytes, size, 1, stdin) == 1; }

void transmit(const void *bytes, uint32_t size) {
    if (fwrite(bytes, size, 1, stdout) != 1 || fflush(stdout) != 0) {
        exit(EXIT_FAILURE);
    }
}

uint32_t clocked(Step *step, Unit *unit, const Inputs *inputs, Outputs *outputs) {
    step(unit, inputs, outputs);
    return 0;
}

void mark_stack(void) {}

uint32_t stack_bytes(void) { return 0; }
