/* {{ experiment.name }} as a function of inputs and outputs, for CompiledController of the library opensourceleg.
   Printed by twin_gait {{ version }}; source {{ project.program.source_hash[:16] }}. Not a medical device. */
#ifndef TWIN_GAIT_OSL_H
#define TWIN_GAIT_OSL_H

#include <stdint.h>

/* Numbers are double and SI: rad, A, V, N·m. NAN is a missing reading. */
typedef struct {
{% for field in inputs %}
    {{ "int32_t" if field.whole else "double" }} {{ field.name }}; /* {{ field.meaning }} */
{% endfor %}
} Inputs;

typedef struct {
{% for field in outputs %}
    {{ "int32_t" if field.whole else "double" }} {{ field.name }}; /* {{ field.meaning }} */
{% endfor %}
} Outputs;

/* Set the controller to tick 0. */
void {{ prefix }}_init(void);

/* Run the ticks since the last call, and write the outputs of the last of them. */
void {{ prefix }}_step(const Inputs *given, Outputs *taken);

#endif
