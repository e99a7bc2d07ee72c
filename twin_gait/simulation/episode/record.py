"""The row of a tick in the log, but for what the controller writes itself."""

from __future__ import annotations

from twin_gait.core.plant import FRICTION, SPRING, STOP
from twin_gait.simulation.episode.motion import acceleration
from twin_gait.simulation.episode.sensors import foot_sum
from twin_gait.simulation.episode_arrays import (
    ANKLE_WIDTH,
    BRACE_WIDTH,
    BUS_VOLTAGE,
    FIRST_ROW,
    FOOT_WIDTH,
    GRAVITY,
    IMPOSED_MOTION_INDEX,
    IMPOSED_MOTION_TORQUE,
    JOINT_WIDTH,
    N_ANKLES,
    N_LEGS,
    PASSIVE,
    PELVIS_INDEX,
    PELVIS_WIDTH,
    PERIOD,
    POINTS_PER_FOOT,
    SAFETY_WIDTH,
    TIME,
    TRIP_CAUSE,
    TRIP_TICK,
    WEARER_SHIFT,
    Array,
    Episode,
)
from twin_gait.simulation.kernel_interface import observe


def record(episode: Episode, tick: int, battery_power: float, rows: Array) -> None:
    """Write everything that is not a controller's, at the state before integration."""
    inputs, state = episode.inputs, episode.state
    state.changing[TIME] = tick * inputs.numbers[PERIOD]
    acceleration(episode, 0.0, 0.0, state.q, state.v, state.a)
    row = tick - inputs.integers[FIRST_ROW]
    for leg in range(inputs.integers[N_LEGS]):
        rows[row, leg] = state.phase[leg]
    for joint in range(inputs.coordinates.shape[0]):
        index = inputs.coordinates[joint]
        first = inputs.integers[N_LEGS] + JOINT_WIDTH * joint
        rows[row, first] = state.q[index]
        rows[row, first + 1] = state.v[index]
        rows[row, first + PASSIVE] = state.passive[index, FRICTION]
        rows[row, first + PASSIVE + 1] = state.passive[index, STOP]
        imposed_motion = (
            state.changing[IMPOSED_MOTION_TORQUE] if inputs.integers[IMPOSED_MOTION_INDEX] == index else 0.0
        )
        rows[row, first + PASSIVE + 2] = imposed_motion + state.external[index]
        if inputs.integers[WEARER_SHIFT] != 0:
            rows[row, first + PASSIVE + 2] += state.external[index + inputs.integers[WEARER_SHIFT]]
    place = inputs.integers[N_LEGS] + JOINT_WIDTH * inputs.coordinates.shape[0]
    for ankle in range(inputs.integers[N_ANKLES]):
        index = inputs.ankles[ankle]
        rows[row, place] = state.q[index]
        rows[row, place + 1] = state.v[index]
        rows[row, place + 2] = state.passive[index, SPRING]
        place += ANKLE_WIDTH
    per_foot = inputs.integers[POINTS_PER_FOOT]
    if per_foot > 0:
        for leg in range(inputs.integers[N_LEGS]):
            rows[row, place] = foot_sum(state.points, leg, per_foot, 1)
            rows[row, place + 1] = foot_sum(state.points, leg, per_foot, 0)
            lowest = state.points[leg * per_foot, 2]
            for number in range(leg * per_foot, (leg + 1) * per_foot):
                lowest = min(lowest, state.points[number, 2])
            rows[row, place + 2] = lowest
            place += FOOT_WIDTH
    kinetic, potential, force, moment = observe(
        state.q, state.v, state.a, inputs.bodies, inputs.numbers[GRAVITY], state.points
    )
    pelvis = inputs.integers[PELVIS_INDEX]
    if pelvis >= 0:
        rows[row, place] = state.q[pelvis]
        rows[row, place + 1] = state.v[pelvis]
        hung = pelvis + inputs.integers[WEARER_SHIFT]
        rows[row, place + 2] = state.passive[hung, SPRING] + state.passive[hung, STOP]
        rows[row, place + 3] = force
        rows[row, place + 4] = moment
        place += PELVIS_WIDTH
    rows[row, place] = state.changing[BUS_VOLTAGE]
    rows[row, place + 1] = battery_power
    rows[row, place + 2] = kinetic
    rows[row, place + 3] = potential
    place += 4
    for source in range(state.works.shape[0]):
        rows[row, place + source] = state.works[source]
    place += state.works.shape[0]
    rows[row, place] = 1.0 if state.safety[TRIP_TICK] >= 0 else 0.0
    rows[row, place + 1] = state.safety[TRIP_CAUSE]
    if inputs.integers[WEARER_SHIFT] != 0:
        _record_braces(episode, row, place + SAFETY_WIDTH, rows)


def _record_braces(episode: Episode, row: int, place: int, rows: Array) -> None:
    """Write the wearer's own motion and the torque of the device on them."""
    inputs, state = episode.inputs, episode.state
    for number in range(inputs.braced.shape[0]):
        index = inputs.braced[number]
        rows[row, place] = state.q[index + inputs.integers[WEARER_SHIFT]]
        rows[row, place + 1] = state.v[index + inputs.integers[WEARER_SHIFT]]
        rows[row, place + 2] = state.brace[index]
        place += BRACE_WIDTH
