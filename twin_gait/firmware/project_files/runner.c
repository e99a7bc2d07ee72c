/* Run the exoskeleton on the inputs of a file of vectors, and compare. With double numbers all is the same,
   bit for bit; with float every phase is entered within a tick, and the currents differ by 1e-4 A RMS at most. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "exoskeleton.h"

#define JOINTS (sizeof((Exoskeleton *)0)->boards / sizeof((Exoskeleton *)0)->boards[0])
#define LEGS (sizeof((ExoskeletonOutputs *)0)->decision.phases / sizeof(int32_t))
#define LARGEST_MEAN_SQUARE 1e-8 /* [A^2] */

typedef struct {
    ExoskeletonInputs inputs;
    ExoskeletonOutputs outputs; /* expected */
} Row;

static real next_number(FILE *file)
{
    double number = 0.0;
    return fscanf(file, "%lf%*1[,\n]", &number) == 1 ? (real)number : REAL(0.0);
}

/* Read a row; false at the end of the file. */
static bool read_row(FILE *file, Row *row)
{
    for (size_t joint = 0; joint < JOINTS; joint++) {
        JointBoardInputs *board = &row->inputs.boards[joint];
        board->angle = next_number(file);
        board->voltage = next_number(file);
        board->current = next_number(file);
        board->current_deviation = next_number(file);
    }
    for (size_t leg = 0; leg < LEGS; leg++) {
        row->inputs.surroundings.loads[leg] = next_number(file);
    }
    row->inputs.surroundings.bus_voltage = next_number(file);
    real *common = (real *)&row->inputs.surroundings.common;
    for (size_t place = 0; place < sizeof row->inputs.surroundings.common / sizeof(real); place++) {
        common[place] = next_number(file);
    }
{% if experiment.modes %}
    row->inputs.surroundings.request = (int32_t)next_number(file);
{% endif %}
    for (size_t joint = 0; joint < JOINTS; joint++) {
        row->outputs.commands[joint].torque = next_number(file);
        row->outputs.commands[joint].target_current = next_number(file);
    }
    for (size_t leg = 0; leg < LEGS; leg++) {
        row->outputs.decision.phases[leg] = (int32_t)next_number(file);
    }
    row->outputs.decision.trip_cause = (int32_t)next_number(file);
    return !feof(file);
}

static bool is_same(real a, real b) { return a == b || (a != a && b != b); }

/* Phases of the middle one of three ticks, of which the neighbours may be late or early by one. */
static bool is_near(const Decision *given, const Decision expected[3])
{
    bool near = true;
    for (size_t leg = 0; leg < LEGS; leg++) {
        bool found = false;
        for (int tick = 0; tick < 3; tick++) {
            found = found || given->phases[leg] == expected[tick].phases[leg];
        }
        near = near && found;
    }
    return near;
}

int main(int count, char **words)
{
    static Exoskeleton unit;
    static Row row;
    static ExoskeletonOutputs given;
    static Decision last_given, expected[3];
    double squares = 0.0;
    long ticks = 0, different = 0, late = 0;
    FILE *file = count == 2 ? fopen(words[1], "r") : NULL;
    if (file == NULL) {
        fprintf(stderr, "runner: expected the name of a file of vectors\n");
        return 2;
    }
    if (fscanf(file, "%*[^\n]") != 0) {
        return 2;
    }
    exoskeleton_init(&unit);
    for (; read_row(file, &row); ticks++) {
        exoskeleton_step(&unit, &row.inputs, &given);
        bool same = given.decision.trip_cause == row.outputs.decision.trip_cause;
        for (size_t leg = 0; leg < LEGS; leg++) {
            same = same && given.decision.phases[leg] == row.outputs.decision.phases[leg];
        }
        for (size_t joint = 0; joint < JOINTS; joint++) {
            const Command *command = &given.commands[joint], *wanted = &row.outputs.commands[joint];
            const double error = (double)command->target_current - (double)wanted->target_current;
            same = same && is_same(command->torque, wanted->torque)
                && is_same(command->target_current, wanted->target_current);
            squares += error * error;
        }
        different += same ? 0 : 1;
        expected[0] = ticks > 1 ? expected[1] : row.outputs.decision;
        expected[1] = ticks > 0 ? expected[2] : row.outputs.decision;
        expected[2] = row.outputs.decision;
        late += ticks == 0 || is_near(&last_given, expected) ? 0 : 1;
        last_given = given.decision;
    }
    fclose(file);
    const double mean_square = ticks > 0 ? squares / (double)(ticks * (long)JOINTS) : 0.0;
    printf("%ld ticks: %ld with other bits, %ld with a phase more than a tick away, currents differ by %.3g A RMS\n",
        ticks, different, late, sqrt(mean_square));
#ifdef REAL_DOUBLE
    return ticks > 0 && different == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
#else
    return ticks > 0 && late == 0 && mean_square <= LARGEST_MEAN_SQUARE ? EXIT_SUCCESS : EXIT_FAILURE;
#endif
}
