/* Feed the units with wild inputs, from a seed: NaN, infinities, numbers of any size, encoders that stand
   still or jump. Currents have to stay finite and within the limit; a wild angle has to trip. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "exoskeleton.h"
#include "gait_controller.h"
#include "joint_board.h"

#define JOINTS (sizeof((Exoskeleton *)0)->boards / sizeof(BoardState))
#define LEGS (sizeof((ExoskeletonOutputs *)0)->decision.phases / sizeof(int32_t))
#define CALM 200     /* ticks of an episode before anything is wild */
#define EPISODE 1000 /* ticks */
#define WITHIN 50    /* ticks from a wild angle to the trip */

enum { MISSING, INFINITE, HUGE_ANGLE, JUMPING, STUCK, WILD_DRIVE, WILD_FEET, WILD_SUPPLY, WILD_ALL, KINDS };

static uint64_t seed;

static uint32_t draw(void) /* xorshift64* of Vigna (2016) */
{
    seed ^= seed >> 12;
    seed ^= seed << 25;
    seed ^= seed >> 27;
    return (uint32_t)((seed * 2685821657736338717u) >> 32);
}

static real uniform(double low, double high)
{
    return (real)(low + (high - low) * (double)draw() / 4294967296.0);
}

static real wild(void)
{
    static const double odd[] = {0.0, -0.0, 1e-45, 1e-38, 1e9, -1e9, 1e20, 3e38, -3e38};
    const uint32_t kind = draw() % 16;
    if (kind < 9) {
        return (real)odd[kind];
    }
    return kind == 9 ? (real)INFINITY : kind == 10 ? -(real)INFINITY : kind < 14 ? (real)NAN : uniform(-100.0, 100.0);
}

static int fail(const char *what, long tick, int kind, real value)
{
    printf("tick %ld, kind %d: %s %g\n", tick, kind, what, (double)value);
    return EXIT_FAILURE;
}

static bool is_driven(real current, real limit)
{
    return real_isfinite(current) && real_abs(current) <= limit;
}

static void fill_wild(void *numbers, size_t bytes)
{
    for (size_t place = 0; place + sizeof(real) <= bytes; place += sizeof(real)) {
        const real number = wild();
        memcpy((char *)numbers + place, &number, sizeof number);
    }
}

static void fill_setpoint(JointSetpoint *setpoint)
{
    setpoint->stiffness = wild();
    setpoint->damping = wild();
    setpoint->equilibrium = wild();
    setpoint->gain = wild();
    setpoint->gravity = wild();
    setpoint->inertia = wild();
    setpoint->target = wild();
    setpoint->held = draw() % 4 == 0;
}

static void fill_measurement(Measurement *measurement)
{
    measurement->angle = wild();
    measurement->last_angle = wild();
    measurement->velocity = wild();
    measurement->last_velocity = wild();
    measurement->motor_speed = wild();
    measurement->cause = draw() % 64 == 0 ? (int32_t)draw() : 0;
}

int main(int count, char **words)
{
    static Exoskeleton unit;
    static ExoskeletonInputs inputs;
    static ExoskeletonOutputs outputs;
    static JointBoard board;
    static JointBoardInputs board_inputs;
    static JointBoardOutputs board_outputs;
    static GaitController controller;
    static GaitControllerInputs controller_inputs;
    static GaitControllerOutputs controller_outputs;
    static long episodes[KINDS], trips[KINDS];
    const long ticks = count > 1 ? atol(words[1]) : 0;
    seed = count > 2 ? strtoull(words[2], NULL, 10) + 1u : 1u;
    int kind = 0;
    size_t joint = 0;
    for (long tick = 0; tick < ticks; tick++) {
        const long now = tick % EPISODE;
        if (now == 0) {
            exoskeleton_init(&unit);
            FIRST_BOARD(&board);
            gait_controller_init(&controller);
            kind = (int)(draw() % KINDS);
            joint = draw() % JOINTS;
        }
        for (size_t place = 0; place < JOINTS; place++) {
            JointBoardInputs *read = &inputs.boards[place];
            read->angle = now == 0 ? unit.boards[place].encoder.angle : read->angle + uniform(-2e-4, 2e-4);
            read->current = uniform(-1.0, 1.0);
            read->voltage = REAL(0.84) * read->current;
            read->current_deviation = uniform(-0.1, 0.1);
        }
        for (size_t leg = 0; leg < LEGS; leg++) {
            inputs.direct.loads[leg] = uniform(0.0, 1.0);
        }
        inputs.direct.bus_voltage = uniform(28.0, 29.0);
        inputs.direct.device_signals.walk = REAL(1.0);
        ExoskeletonInputs given = inputs;
        JointBoardInputs *read = &given.boards[joint];
        if (now >= CALM) {
            switch (kind) {
            case MISSING: read->angle = (real)NAN; break;
            case INFINITE: read->angle = draw() % 2 ? (real)INFINITY : -(real)INFINITY; break;
            case HUGE_ANGLE: read->angle = (real)(draw() % 2 ? 3e38 : -1e12); break;
            case JUMPING: read->angle += draw() % 2 ? REAL(1.0) : REAL(0.0); break;
            case STUCK: read->angle = inputs.boards[joint].angle = REAL(0.2); read->voltage += REAL(8.0); break;
            case WILD_DRIVE: read->voltage = wild(); read->current = wild(); read->current_deviation = wild(); break;
            case WILD_FEET: fill_wild(given.direct.loads, sizeof given.direct.loads); break;
            case WILD_SUPPLY: given.direct.bus_voltage = wild(); given.direct.device_signals.walk = wild(); break;
            default:
                for (size_t place = 0; place < JOINTS; place++) {
                    given.boards[place].angle = draw() % 8 ? given.boards[place].angle : wild();
                    given.boards[place].voltage = wild();
                    given.boards[place].current = wild();
                    given.boards[place].current_deviation = wild();
                }
                fill_wild(&given.direct, sizeof given.direct);
            }
        }
        exoskeleton_step(&unit, &given, &outputs);
        for (size_t place = 0; place < JOINTS; place++) {
            if (!is_driven(outputs.commands[place].target_current, unit.boards[place].limits->current)) {
                return fail("exoskeleton asks for", tick, kind, outputs.commands[place].target_current);
            }
        }
        if (kind <= JUMPING && now == CALM + WITHIN && outputs.decision.trip_cause == 0) {
            return fail("no trip", tick, kind, read->angle);
        }
        if (now == EPISODE - 1) {
            episodes[kind]++;
            trips[kind] += outputs.decision.trip_cause != 0;
        }
        board_inputs = *read;
        board_inputs.received = draw() % 4 != 0;
        if (now < CALM) {
            board_inputs.setpoint = controller_outputs.setpoints[joint];
        } else {
            fill_setpoint(&board_inputs.setpoint);
        }
        joint_board_step(&board, &board_inputs, &board_outputs);
        if (!is_driven(board_outputs.command.target_current, board.state.limits->current)) {
            return fail("joint board asks for", tick, kind, board_outputs.command.target_current);
        }
        controller_inputs.direct = given.direct;
        for (size_t place = 0; place < JOINTS; place++) {
            controller_inputs.received[place] = draw() % 4 != 0;
            fill_measurement(&controller_inputs.measurements[place]);
        }
        gait_controller_step(&controller, &controller_inputs, &controller_outputs);
        for (size_t leg = 0; leg < LEGS; leg++) {
            if (controller_outputs.decision.phases[leg] < 0 || controller_outputs.decision.phases[leg] >= PHASES) {
                return fail("no phase", tick, kind, REAL(0.0));
            }
        }
    }
    for (kind = 0; kind < KINDS; kind++) {
        printf("%ld %ld\n", episodes[kind], trips[kind]);
    }
    return EXIT_SUCCESS;
}
