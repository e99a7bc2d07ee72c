/* See osl.h. The record of the controller is the only variable: a library has one controller, because the interface of
   CompiledController passes none. Printed by twin_gait {{ version }}. Not a medical device. */
#include "osl.h"

#include "exoskeleton.h"

#define JOINTS {{ project.joints | length }}
#define LONGEST_STEP {{ longest_step }} /* [ticks]; after a longer or a negative time all readings are missing, and the monitor trips */

static Exoskeleton unit;
static ExoskeletonOutputs outputs;
static real last_angle[JOINTS];
static bool has_angle;

void {{ prefix }}_init(void)
{
    exoskeleton_init(&unit);
    outputs = (ExoskeletonOutputs){0};
    has_angle = false;
}

void {{ prefix }}_step(const Inputs *given, Outputs *taken)
{
    ExoskeletonInputs inputs = {0};
    const bool late = given->ticks < 0 || given->ticks > LONGEST_STEP;
    const int32_t ticks = late ? 1 : given->ticks;
    if (ticks == 0) {
        return; /* no time has passed: the outputs remain */
    }
    const real angle[JOINTS] = { {%- for joint in project.joints %}(real)given->{{ joint }}_angle{{ "" if loop.last else ", " }}{% endfor %} };

{% for joint in project.joints %}
    inputs.boards[{{ loop.index0 }}].voltage = (real)given->{{ joint }}_voltage;
    inputs.boards[{{ loop.index0 }}].current = (real)given->{{ joint }}_current;
    inputs.boards[{{ loop.index0 }}].current_deviation = (real)given->{{ joint }}_current_deviation;
{% endfor %}
{% for side in experiment.sides %}
    inputs.direct.loads[{{ loop.index0 }}] = (real)given->{{ side }}_load;
{% endfor %}
    inputs.direct.bus_voltage = (real)given->bus_voltage;
    inputs.direct.device_signals.trunk_pitch = (real)given->trunk_pitch;
{% if experiment.modes %}
    inputs.direct.request = given->request;
{% else %}
    inputs.direct.device_signals.walk = (real)given->walk;
    inputs.direct.device_signals.step = (real)given->step;
{% endif %}
    for (int32_t tick = 1; tick <= ticks; tick++) {
        for (int joint = 0; joint < JOINTS; joint++) {
            /* The angle moves in a straight line from the last reading to this one. */
            const real share = (real)tick / (real)ticks;
            const bool between = has_angle && tick < ticks;
            const real moved = share * (angle[joint] - last_angle[joint]);
            inputs.boards[joint].angle = late ? (real)NAN : between ? last_angle[joint] + moved : angle[joint];
        }
        exoskeleton_step(&unit, &inputs, &outputs);
    }
    for (int joint = 0; joint < JOINTS; joint++) {
        last_angle[joint] = angle[joint];
    }
    has_angle = true;
{% for joint in project.joints %}
    taken->{{ joint }}_current = (double)outputs.commands[{{ loop.index0 }}].target_current;
    taken->{{ joint }}_torque = (double)outputs.commands[{{ loop.index0 }}].torque;
    taken->{{ joint }}_stiffness = (double)outputs.setpoints[{{ loop.index0 }}].stiffness;
    taken->{{ joint }}_damping = (double)outputs.setpoints[{{ loop.index0 }}].damping;
    taken->{{ joint }}_equilibrium = (double)outputs.setpoints[{{ loop.index0 }}].equilibrium;
    taken->{{ joint }}_held = outputs.setpoints[{{ loop.index0 }}].held ? 1 : 0;
{% endfor %}
{% for side in experiment.sides %}
    taken->{{ side }}_phase = outputs.decision.phases[{{ loop.index0 }}];
{% endfor %}
{% if experiment.modes %}
    taken->mode = outputs.decision.mode;
{% endif %}
    taken->trip_cause = outputs.decision.trip_cause;
}
