/* Main loop: transmit sizes and the clock's calibration, then for each tick receive inputs, step, transmit outputs and
   cost. */
#include "loop.h"

int main(void) {
    static Unit unit;
    static Inputs inputs;
    static Outputs outputs;
    uint32_t sizes[] = {sizeof inputs, sizeof outputs, sizeof unit};
    uint32_t calibration[CALIBRATION] = {0};
    open_channel(calibration);
    transmit(sizes, sizeof sizes);
    transmit(calibration, sizeof calibration);
    unit_init(&unit);
    mark_stack();
    while (receive(&inputs, sizeof inputs)) {
        const uint32_t counts = clocked(unit_step, &unit, &inputs, &outputs);
        const uint32_t cost[] = {counts, stack_bytes()};
        transmit(&outputs, sizeof outputs);
        transmit(cost, sizeof cost);
    }
    return 0;
}
