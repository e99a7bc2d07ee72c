/* Run all units on the inputs of a walk and on generated inputs, and compare them with the simulation. With double
   numbers all outputs are equal bit for bit; with float every phase of the walk is entered within one tick, and the
   currents differ by at most 1e-4 A RMS. The generated inputs are compared with double numbers only. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

{% if project.messages %}
#include "can_codec_step.h"
{% endif %}
#include "exoskeleton.h"
#include "gait_controller.h"
#include "joint_board.h"

#define JOINTS (sizeof((Exoskeleton *)0)->boards / sizeof((Exoskeleton *)0)->boards[0])
#define N_LEGS (sizeof((ExoskeletonOutputs *)0)->decision.phases / sizeof(int32_t))
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
    for (size_t leg = 0; leg < N_LEGS; leg++) {
        row->inputs.direct.loads[leg] = next_number(file);
    }
    row->inputs.direct.bus_voltage = next_number(file);
    real *signals = (real *)&row->inputs.direct.device_signals;
    for (size_t index = 0; index < sizeof row->inputs.direct.device_signals / sizeof(real); index++) {
        signals[index] = next_number(file);
    }
{% if experiment.modes %}
    row->inputs.direct.request = (int32_t)next_number(file);
{% endif %}
    for (size_t joint = 0; joint < JOINTS; joint++) {
        row->outputs.commands[joint].torque = next_number(file);
        row->outputs.commands[joint].target_current = next_number(file);
    }
    for (size_t leg = 0; leg < N_LEGS; leg++) {
        row->outputs.decision.phases[leg] = (int32_t)next_number(file);
    }
    row->outputs.decision.trip_cause = (int32_t)next_number(file);
    return !feof(file);
}

static bool is_same(real a, real b) { return a == b || (a != a && b != b); }

/* Return whether the phases of a tick are expected in the same tick, the tick before or the tick after. */
static bool is_near(const Decision *given, const Decision expected[3])
{
    bool near = true;
    for (size_t leg = 0; leg < N_LEGS; leg++) {
        bool found = false;
        for (int tick = 0; tick < 3; tick++) {
            found = found || given->phases[leg] == expected[tick].phases[leg];
        }
        near = near && found;
    }
    return near;
}

/* The separate units: a board receives the setpoint of its tick, the gait controller the measurements. */
typedef struct {
    JointBoard boards[JOINTS];
    GaitController controller;
    JointBoardOutputs measured[JOINTS];
    GaitControllerOutputs decided;
} Apart;

static void start_apart(Apart *apart)
{
{% for joint in project.joints %}
    joint_board_{{ joint }}_init(&apart->boards[{{ loop.index0 }}]);
{% endfor %}
    gait_controller_init(&apart->controller);
}

static bool is_same_setpoint(const JointSetpoint *a, const JointSetpoint *b)
{
    return is_same(a->stiffness, b->stiffness) && is_same(a->damping, b->damping)
        && is_same(a->equilibrium, b->equilibrium) && is_same(a->gain, b->gain) && is_same(a->gravity, b->gravity)
        && is_same(a->inertia, b->inertia) && is_same(a->target, b->target) && a->held == b->held;
}

/* Run a tick of the separate units; return whether commands and decision are those of the file, and the setpoints those
   of the exoskeleton. */
static bool step_apart(Apart *apart, const Row *row, const ExoskeletonOutputs *given)
{
    bool same = true;
    GaitControllerInputs central_inputs = {.direct = row->inputs.direct};
    for (size_t joint = 0; joint < JOINTS; joint++) {
        JointBoardInputs inputs = row->inputs.boards[joint];
        inputs.setpoint = given->setpoints[joint];
        inputs.received = true;
        joint_board_step(&apart->boards[joint], &inputs, &apart->measured[joint]);
        const Command *command = &apart->measured[joint].command;
        const Command *wanted = &row->outputs.commands[joint];
        /* In the exoskeleton the gait controller holds a board that has tripped; a separate board holds itself. */
        const bool tripped = apart->measured[joint].measurement.cause != 0;
        same = same && (tripped || (is_same(command->torque, wanted->torque)
            && is_same(command->target_current, wanted->target_current)));
        central_inputs.measurements[joint] = apart->measured[joint].measurement;
        central_inputs.received[joint] = true;
    }
    gait_controller_step(&apart->controller, &central_inputs, &apart->decided);
    for (size_t joint = 0; joint < JOINTS; joint++) {
        same = same && is_same_setpoint(&apart->decided.setpoints[joint], &given->setpoints[joint]);
    }
    for (size_t leg = 0; leg < N_LEGS; leg++) {
        same = same && apart->decided.decision.phases[leg] == row->outputs.decision.phases[leg];
    }
    return same && apart->decided.decision.trip_cause == row->outputs.decision.trip_cause;
}

#ifdef REAL_DOUBLE
/* Add a number to a hash; all NaN count as one. */
static uint64_t add(uint64_t hash, double number)
{
    uint64_t bits;
    const double counted = number == number ? number : NAN;
    memcpy(&bits, &counted, sizeof bits);
    return hash * 1099511628211u + (number == number ? bits : 0x7FF8000000000000u);
}

{% for unit in excited %}
/* Run a tick of {{ unit.name }} on numbers of the file, and add its outputs to a hash. */
static uint64_t excite_{{ unit.name }}({{ unit.record }} *unit, const double *numbers, uint64_t hash)
{
    static {{ unit.record }}Inputs inputs;
    static {{ unit.record }}Outputs outputs;
    {% for member, conversion in unit.inputs %}
    inputs.{{ member }} = {{ conversion }}numbers[{{ loop.index0 }}];
    {% endfor %}
    {{ unit.name }}_step(unit, &inputs, &outputs);
    {% for member, _ in unit.outputs %}
    hash = add(hash, (double)outputs.{{ member }});
    {% endfor %}
    return hash;
}

{% endfor %}
enum { MOST_NUMBERS = {{ most_numbers }} };

/* Run the generated inputs of a file; return the number of lines whose outputs differ, -1 for a wrong file. */
static long excite(FILE *file)
{
{% for unit in excited %}
    static {{ unit.record }} {{ unit.name }};
{% endfor %}
    static const size_t counts[] = { {{ counts | join(", ") }} };
    double numbers[MOST_NUMBERS];
    size_t unit;
    int restart;
    long ticks, lines = 0, different = 0;
    if (fscanf(file, "%*[^\n]") != 0) {
        return -1;
    }
    while (fscanf(file, "%zu,%d,%ld", &unit, &restart, &ticks) == 3) {
        uint64_t hash = 0, expected = 0;
        if (unit >= sizeof counts / sizeof counts[0]) {
            return -1;
        }
        for (size_t index = 0; index < counts[unit]; index++) {
            if (fscanf(file, ",%lf", &numbers[index]) != 1) {
                return -1;
            }
        }
        if (fscanf(file, ",%" SCNu64, &expected) != 1) {
            return -1;
        }
        switch (unit) {
{% for sample in project.samples %}
        case {{ loop.index0 }}:
            if (restart) {
                {{ sample.init }}_init(&{{ sample.name }});
            }
            for (long tick = 0; tick < ticks; tick++) {
                hash = hash * 1099511628211u + excite_{{ sample.name }}(&{{ sample.name }}, numbers, 0);
            }
            break;
{% endfor %}
        default:
            return -1;
        }
        lines++;
        different += hash == expected ? 0 : 1;
    }
    printf("generated inputs: %ld lines, %ld with other bits\n", lines, different);
    return lines > 0 ? different : -1;
}
#endif

int main(int count, char **words)
{
    static Exoskeleton unit;
    static Row row;
    static ExoskeletonOutputs given;
    static Apart apart;
    static Decision last_given, expected[3];
    double squares = 0.0;
    long ticks = 0, different = 0, different_apart = 0, late = 0;
    FILE *file = count == 3 ? fopen(words[1], "r") : NULL;
    FILE *generated = count == 3 ? fopen(words[2], "r") : NULL;
    if (file == NULL || generated == NULL) {
        fprintf(stderr, "runner: expected the names of two files: vectors.csv and excitation.csv\n");
        return 2;
    }
    if (fscanf(file, "%*[^\n]") != 0) {
        return 2;
    }
    exoskeleton_init(&unit);
    start_apart(&apart);
    for (; read_row(file, &row); ticks++) {
        exoskeleton_step(&unit, &row.inputs, &given);
        bool same = given.decision.trip_cause == row.outputs.decision.trip_cause;
        for (size_t leg = 0; leg < N_LEGS; leg++) {
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
        different_apart += step_apart(&apart, &row, &given) ? 0 : 1;
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
    printf("boards and gait controller apart: %ld ticks with other bits\n", different_apart);
#ifdef REAL_DOUBLE
    const long wrong = excite(generated);
    fclose(generated);
    return ticks > 0 && different == 0 && different_apart == 0 && wrong == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
#else
    fclose(generated);
    return ticks > 0 && late == 0 && mean_square <= LARGEST_MEAN_SQUARE ? EXIT_SUCCESS : EXIT_FAILURE;
#endif
}
