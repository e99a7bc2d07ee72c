/* Functional mock-up unit (FMI 2.0, co-simulation) of the printed unit {{ unit.name }}. Numbers are double.
   Build it with -ffp-contract=off and libm, so that it gives the bits of the simulation. Not a medical device. */
#define REAL_DOUBLE
#include "{{ unit.name }}.c"

#include <stdlib.h>
#include <string.h>

#include "fmi2.h"

#define GUID "{{ guid }}"
#define PERIOD {{ period }} /* [s] */

/* All that changes; it has no pointers, so that a copy of it is a state of the FMU. */
typedef struct {
    {{ unit_type }} unit;
    {{ inputs_type }} inputs;
    {{ outputs_type }} outputs;
    double time;
    bool running; /* whether the initialization is over */
    bool changed; /* whether parameters have been set since the last call of {{ unit.prefix }}_update */
} State;

typedef struct {
    State state;
    fmi2CallbackFunctions callbacks;
    char name[64];
} Instance;

typedef enum { REAL_VARIABLE, INTEGER_VARIABLE, BOOLEAN_VARIABLE } Type;

typedef struct {
    size_t offset;
    Type type;
    char causality; /* 'i' for an input, 'o' for an output, 'p' for a tunable parameter */
    real sign; /* -1 if the unit stores the negative of the variable */
    int32_t low, high; /* limits of an integer that is set, which may be an index */
} Variable;

/* Variables in the order of their value references. */
static const Variable variables[] = {
{% for item in variables %}
    {offsetof(State, {{ item.path }}), {{ item.type|upper }}_VARIABLE, '{{ item.causality[0] }}', {{ item.sign }},
        {{ "INT32_MIN, INT32_MAX" if item.most is none else "0, %d" % item.most }}},
{% endfor %}
};
enum { N_VARIABLES = sizeof variables / sizeof variables[0] };

static fmi2Status report(const Instance *instance, fmi2String message) {
    const fmi2CallbackFunctions *callbacks = &instance->callbacks;
    if (callbacks->logger != NULL) {
        callbacks->logger(callbacks->componentEnvironment, instance->name, fmi2Error, "logStatusError", message);
    }
    return fmi2Error;
}

static void start(State *state) {
    memset(state, 0, sizeof *state);
    {{ unit.prefix }}_init(&state->unit);
{% for item in variables if item.causality == "input" %}
    state->{{ item.path }} = {{ item.c_start }};
{% endfor %}
    state->changed = true;
}

/* Make the outputs valid after a change of parameters. Before the first step the unit itself is not changed, because
   further parameters may follow. */
static void refresh(State *state) {
    if (state->changed && state->running) {
        {{ unit.prefix }}_update(&state->unit, &state->outputs);
    } else if (state->changed) {
        {{ unit_type }} copy = state->unit;
        {{ unit.prefix }}_update(&copy, &state->outputs);
    }
    state->changed = false;
}

/* Return the address of a variable, NULL if there is none of this type, or none that may be set. */
static void *address(Instance *instance, fmi2ValueReference reference, Type type, bool set) {
    if (reference >= N_VARIABLES || variables[reference].type != type || (set && variables[reference].causality == 'o')) {
        (void)report(instance, "a value reference does not belong to a variable of this type and causality");
        return NULL;
    }
    if (!set) {
        refresh(&instance->state);
    } else if (variables[reference].causality == 'p') {
        instance->state.changed = true;
    }
    return (char *)&instance->state + variables[reference].offset;
}

EXPORT fmi2String fmi2GetTypesPlatform(void) { return "default"; }

EXPORT fmi2String fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
        const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)resources, (void)visible, (void)logging;
    Instance *instance = calloc(1, sizeof *instance);
    if (instance == NULL) {
        return NULL;
    }
    if (callbacks != NULL) {
        instance->callbacks = *callbacks;
    }
    (void)strncpy(instance->name, name, sizeof instance->name - 1);
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, GUID) != 0) {
        (void)report(instance, "expected co-simulation, and the GUID of modelDescription.xml");
        free(instance);
        return NULL;
    }
    start(&instance->state);
    return instance;
}

EXPORT void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
        fmi2Real start_time, fmi2Boolean stop_time_defined, fmi2Real stop_time) {
    (void)tolerance_defined, (void)tolerance, (void)stop_time_defined, (void)stop_time;
    ((Instance *)c)->state.time = start_time;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    State *state = &((Instance *)c)->state;
    state->running = state->changed = true;
    refresh(state);
    return fmi2OK;
}

EXPORT fmi2Status fmi2Terminate(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(fmi2Component c) {
    start(&((Instance *)c)->state);
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state) {
    (void)no_set_state;
    Instance *instance = c;
    State *state = &instance->state;
    const double ticks = step / PERIOD;
    const long whole = ticks < 1e9 ? (long)(ticks + 0.5) : 0;
    if (whole < 1 || real_abs(ticks - (double)whole) > 1e-6) {
        return report(instance, "the step has to be a multiple of 1 ms");
    }
    refresh(state);
    for (long tick = 0; tick < whole; tick++) {
        {{ unit.prefix }}_step(&state->unit, &state->inputs, &state->outputs);
    }
    state->time = time + step;
    return fmi2OK;
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { return report(c, "steps are synchronous"); }
{% for type, c_type in (("Real", "real"), ("Integer", "int32_t"), ("Boolean", "bool")) %}
{% set sign = "variables[references[i]].sign * " if type == "Real" else "" %}

EXPORT fmi2Status fmi2Get{{ type }}(fmi2Component c, const fmi2ValueReference references[], size_t n,
        fmi2{{ type }} values[]) {
    for (size_t i = 0; i < n; i++) {
        const {{ c_type }} *found = address(c, references[i], {{ type|upper }}_VARIABLE, false);
        if (found == NULL) {
            return fmi2Error;
        }
        values[i] = {{ sign }}*found;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2Set{{ type }}(fmi2Component c, const fmi2ValueReference references[], size_t n,
        const fmi2{{ type }} values[]) {
    for (size_t i = 0; i < n; i++) {
        {{ c_type }} *found = address(c, references[i], {{ type|upper }}_VARIABLE, true);
        if (found == NULL) {
            return fmi2Error;
        }
{% if type == "Integer" %}
        if (values[i] < variables[references[i]].low || values[i] > variables[references[i]].high) {
            return report(c, "an integer is outside the limits that modelDescription.xml states");
        }
{% endif %}
        *found = {{ sign }}values[i]{{ " != 0" if type == "Boolean" else "" }};
    }
    return fmi2OK;
}
{% endfor %}

EXPORT fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference references[], size_t n,
        fmi2String values[]) {
    (void)references, (void)values;
    return n == 0 ? fmi2OK : report(c, "there are no strings");
}

EXPORT fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference references[], size_t n,
        const fmi2String values[]) {
    (void)references, (void)values;
    return n == 0 ? fmi2OK : report(c, "there are no strings");
}

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *copy) {
    if (*copy == NULL && (*copy = malloc(sizeof(State))) == NULL) {
        return report(c, "no memory");
    }
    memcpy(*copy, &((Instance *)c)->state, sizeof(State));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate copy) {
    memcpy(&((Instance *)c)->state, copy, sizeof(State));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *copy) {
    (void)c;
    free(*copy);
    *copy = NULL;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate copy, size_t *size) {
    (void)c, (void)copy;
    *size = sizeof(State);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate copy, fmi2Byte bytes[], size_t size) {
    if (size != sizeof(State)) {
        return report(c, "the bytes are not those of a state of this FMU");
    }
    memcpy(bytes, copy, size);
    return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *copy) {
    if (size != sizeof(State)) {
        return report(c, "the bytes are not those of a state of this FMU");
    }
    if (*copy == NULL && (*copy = malloc(size)) == NULL) {
        return report(c, "no memory");
    }
    memcpy(*copy, bytes, size);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
        const fmi2ValueReference known[], size_t n_known, const fmi2Real d_known[], fmi2Real d_unknown[]) {
    (void)unknown, (void)n_unknown, (void)known, (void)n_known, (void)d_known, (void)d_unknown;
    return report(c, "there are no directional derivatives");
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference references[], size_t n,
        const fmi2Integer orders[], const fmi2Real values[]) {
    (void)references, (void)n, (void)orders, (void)values;
    return report(c, "inputs are constant over a step");
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference references[], size_t n,
        const fmi2Integer orders[], fmi2Real values[]) {
    (void)references, (void)n, (void)orders, (void)values;
    return report(c, "outputs have no derivatives");
}

EXPORT fmi2Status fmi2GetStatus(fmi2Component c, fmi2StatusKind kind, fmi2Status *value) {
    (void)c, (void)kind;
    *value = fmi2OK;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real *value) {
    *value = ((Instance *)c)->state.time;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}

EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, fmi2StatusKind kind, fmi2Integer *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, fmi2StatusKind kind, fmi2Boolean *value) {
    (void)c;
    *value = 0;
    return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, fmi2StatusKind kind, fmi2String *value) {
    (void)c, (void)kind;
    *value = "";
    return fmi2Discard;
}
