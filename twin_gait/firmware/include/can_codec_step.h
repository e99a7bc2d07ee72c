/* The codec as a unit for the test: a step packs numbers into a frame, and unpacks another frame.
   Not a medical device. */
#ifndef TWIN_GAIT_CAN_CODEC_STEP_H
#define TWIN_GAIT_CAN_CODEC_STEP_H

#include "can_codec.h"

typedef struct {
    int32_t message; /* Number of the message, in the order of the README. */
    real values[{{ width }}];
    CanFrame frame;
} CanCodecInputs;

typedef struct {
    CanFrame frame;
    bool known; /* Whether the frame of the inputs belongs to the message. */
    real values[{{ width }}];
} CanCodecOutputs;

typedef struct {
    const CanMessage *messages[{{ messages | length }}];
} CanCodec;

static inline void can_codec_init(CanCodec *unit)
{
{% for name in messages %}
    unit->messages[{{ loop.index0 }}] = &{{ name }};
{% endfor %}
}

static inline void can_codec_step(CanCodec *unit, const CanCodecInputs *inputs, CanCodecOutputs *outputs)
{
    const CanMessage *message = unit->messages[inputs->message];
    can_pack(message, inputs->values, &outputs->frame);
    outputs->known = can_unpack(message, &inputs->frame, outputs->values);
}

#endif
