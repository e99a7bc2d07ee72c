"""The arrays of an episode, and what stands where in those that hold single numbers.

:mod:`twin_gait.simulation.compiled_engine` fills them and
:mod:`twin_gait.simulation.episode` steps through them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from twin_gait.simulation.columns import (
    ANKLE_COLUMNS,
    BRACE_COLUMNS,
    FOOT_COLUMNS,
    JOINT_COLUMNS,
    PELVIS_COLUMNS,
    SAFETY_COLUMNS,
)

Array = np.ndarray[Any, np.dtype[Any]]

COMPLETED, FELL, DIVERGED = 0, 1, 2

# Positions in the array of integers and in the array of numbers of an episode.
(
    N_LEGS,
    JOINTS_PER_LEG,
    POINTS_PER_FOOT,
    DECIMATION,
    BLEND_LAW,
    BLEND_TICKS,
    SUBSTEPS,
    USE_RK4,
    PELVIS_INDEX,
    IMPOSED_MOTION_INDEX,
    N_ANKLES,
    RECORD,
    WATCHING,
    FIRST_FAULT,
    PHASE_TIME_OUT_TICKS,
    FROZEN_LOAD_TICKS,
    VOLTAGE_TICKS,
    LOWERING_TICKS,
    FAULTY,
    INERTIA_WANTED,
    FIRST_ROW,
    WEARER,
    FOLLOWS,
    ASSISTS,
    ADAPTS,
    CYCLE_TICKS,
    WEARER_SHIFT,
) = range(27)
(
    PERIOD,
    FAST_GAIN,
    GRAVITY,
    STEP,
    TORQUE_LIMIT,
    CURRENT_LIMIT,
    BATTERY_VOLTAGE,
    BATTERY_RESISTANCE,
    BODY_WEIGHT,
    FALL_HEIGHT,
    DIVERGED_VELOCITY,
    INERTIA_GAIN,
    LEAST_VOLTAGE,
    HOLD_DAMPING,
    LOWEST_POSTURE,
    POSTURE_STEP,
    FORGETTING,
    ASSISTANCE_GAIN,
    ALLOWANCE,
    LEAST_ASSISTANCE,
    CATCH_STIFFNESS,
    CATCH_DISSIPATION,
) = range(22)
# Positions in the array of numbers that change: bus voltage, time of the step, imposed motion, contact power.
BUS_VOLTAGE, TIME, IMPOSED_MOTION_TORQUE, CONTACT_POWER, LAST_CONTACT_POWER = range(5)
# Positions in the array of what the monitor has done: tick of the trip or -1, its cause and place (a joint,
# or the number of joints plus a leg), drives that are cut off, ticks with too low a bus voltage.
TRIP_TICK, TRIP_CAUSE, TRIP_PLACE, DRIVES_OFF, LOW_VOLTAGE_STREAK = range(5)
INTEGER_COUNT, NUMBER_COUNT, CHANGING_COUNT = WEARER_SHIFT + 1, CATCH_DISSIPATION + 1, LAST_CONTACT_POWER + 1
SAFETY_COUNT = LOW_VOLTAGE_STREAK + 1

# Blocks of the log, and where groups of columns begin in the block of a joint.
JOINT_WIDTH, ANKLE_WIDTH = len(JOINT_COLUMNS), len(ANKLE_COLUMNS)
FOOT_WIDTH, PELVIS_WIDTH = len(FOOT_COLUMNS), len(PELVIS_COLUMNS)
SAFETY_WIDTH, BRACE_WIDTH = len(SAFETY_COLUMNS), len(BRACE_COLUMNS)
MEASURED = JOINT_COLUMNS.index("measured_angle_rad")
CONTROLLED = JOINT_COLUMNS.index("impedance_torque_Nm")
PASSIVE = JOINT_COLUMNS.index("friction_torque_Nm")
ELECTRICAL = JOINT_COLUMNS.index("target_current_A")


class EpisodeInputs(NamedTuple):
    """What does not change in an episode.

    With braces the coordinates are those of the device, then those of the wearer, ``WEARER_SHIFT`` behind.

    Attributes:
        integers: See the positions above, shape ``(INTEGER_COUNT,)``.
        numbers: See the positions above, shape ``(NUMBER_COUNT,)``.
        bodies: Run-time values of the plant's kernel.
        control_bodies: Run-time values of the controller's kernel.
        contact: Present belt speed and contact parameters, shape ``(5,)``.
        belt: What sets its speed, as :mod:`twin_gait.core.belt` reads it, shape ``(BELT_COUNT,)``; the ramp
            is 0 if it runs evenly.
        plant_rows: Passive torques, shape ``(n, PLANT_COLUMNS)``.
        coordinates: Positions of the actuated joints in ``q``, shape ``(n_joints,)``.
        control_coordinates: Likewise in the controller's model.
        ankles: Positions of the ankles in ``q``.
        braces: Stiffness and damping between device and wearer, shape ``(n_device, 2)``.
        braced: Coordinates of the device in the order of the log's braces.
        transitions: Guard program.
        nodes: Guard program.
        comparisons: Guard program.
        minimum_ticks: Guard program.
        phase_rows: Shape ``(n_legs, n_phases, n_columns)``.
        noise: Sensor noise, taken in turn, shape ``(n_ticks or 1, n_joints)``.
        resolution: Encoder resolution, shape ``(n_joints,)``.
        friction_model: a, b, c, d of each joint, shape ``(n_joints, 4)``.
        actuators: K_t, ratio, efficiency, resistance of each joint, shape ``(n_joints, 4)``.
        target_torque: Shape ``(n_joints,)``.
        push: Torque on each joint from outside, held over the tick, shape ``(n_joints,)``.
        conditions: Of the wearer's joints, shape ``(n_joints, CONDITION_COLUMNS)``.
        effort_moments: Normative moments, shape ``(n_joints, n_phases, POSTURES)``.
        effort_noise: Of the wearer's effort, taken in turn, shape ``(n_ticks or 1, n_joints)``.
        path: Angles over the cycle, shape ``(n_samples, joints_per_leg)``.
        path_starts: Share of the cycle at which each leg begins, shape ``(n_legs,)``.
        imposed_motion: Start angle, amplitude, frequency, stiffness, damping, release time, shape ``(6,)``.
        bounds: Of the safety monitor, shape ``(n_joints, BOUND_COUNT)``.
        faults: Kind, place and first tick, shape ``(n, 3)``.
        magnitudes: Of the faults in SI units, shape ``(n,)``.
    """

    integers: Array
    numbers: Array
    bodies: Array
    control_bodies: Array
    contact: Array
    belt: Array
    plant_rows: Array
    coordinates: Array
    control_coordinates: Array
    ankles: Array
    braces: Array
    braced: Array
    transitions: Array
    nodes: Array
    comparisons: Array
    minimum_ticks: Array
    phase_rows: Array
    noise: Array
    resolution: Array
    friction_model: Array
    actuators: Array
    target_torque: Array
    push: Array
    conditions: Array
    effort_moments: Array
    effort_noise: Array
    path: Array
    path_starts: Array
    imposed_motion: Array
    bounds: Array
    faults: Array
    magnitudes: Array


class EpisodeState(NamedTuple):
    """What an episode changes; handed in and kept by the caller.

    Attributes:
        q: Coordinates, shape ``(n,)``.
        v: Velocities, shape ``(n,)``.
        a: Accelerations, shape ``(n,)``.
        measured: Angle, fast and slow velocity, shape ``(n_joints, 3)``.
        decimated_angle: Shape ``(n_joints,)``.
        ring: Slow samples, shape ``(window, n_joints)``.
        rate: Acceleration estimates, shape ``(n_joints,)``.
        phase: Phase of each leg, shape ``(n_legs,)``.
        entry_tick: Tick of entry, shape ``(n_legs,)``.
        debounce: Shape ``(n_legs * n_transitions,)``.
        blend_start: Shape ``(n_legs, n_columns)``.
        blended: Shape ``(n_legs, n_columns)``.
        signals: Of both legs, then the command, shape ``(2 n_signals + 1,)``.
        motor: Motor torques on all coordinates, shape ``(n,)``.
        external: Torques of push and wearer on all coordinates, shape ``(n,)``.
        assistance: Share of the impedance that each joint is given, shape ``(n_joints,)``.
        lead: Torque that lets the damper follow the path, shape ``(n_joints,)``.
        stride_start: Tick at which the stride of each leg began, shape ``(n_legs,)``.
        stride_ticks: Ticks of its last stride, shape ``(n_legs,)``.
        tracking: Sum of the absolute errors of the stride, shape ``(n_joints,)``.
        efforts: Efforts of the last ticks, shape ``(delay + 1, n_joints)``.
        torque: All torques, shape ``(n,)``.
        passive: Shape ``(n, 3)``.
        points: Contact points, shape ``(n_points, 3)``.
        brace: What the device does on the wearer, shape ``(n_device,)``.
        works: By source, shape ``(n_sources,)``.
        changing: See the positions above, shape ``(5,)``.
        stage_q: Room for the integrators, shape ``(n,)``.
        stage_v: Likewise.
        sum_v: Likewise.
        sum_a: Likewise.
        mean_v: Likewise.
        angles: What the sensors read before they are quantised, shape ``(n_joints,)``.
        last_angle: Measured angle of the tick before, shape ``(n_joints,)``.
        last_fast: Fast velocity of the tick before, shape ``(n_joints,)``.
        model_friction: Friction torque of the compensator's model, shape ``(n_joints,)``.
        control_q: Shape ``(n_control,)``.
        control_a: Shape ``(n_control,)``.
        gravity_torque: Shape ``(n_control,)``.
        inertia_torque: Shape ``(n_control,)``.
        legs: Foot loads, shape ``(n_legs,)``.
        leg_ticks: Ticks in phase, shape ``(n_legs,)``.
        before: Phases at the start of the tick, shape ``(n_legs,)``.
        switches: Tick, leg, source, target, transition of each switch, shape ``(capacity, 5)``.
        counters: Number of switches, status, last tick in which the legs were told to stand; shape ``(3,)``.
        watch_memory: Of the safety monitor, shape ``(n_joints, MEMORY_COUNT)``.
        watch_streaks: Of the safety monitor, shape ``(n_joints, STREAK_COUNT)``.
        load_streaks: Ticks in which a foot's load stood still, shape ``(n_legs,)``.
        last_load: Foot loads of the tick before, shape ``(n_legs,)``.
        safety: See the positions above, shape ``(SAFETY_COUNT,)``.
        drive_off: 1 for a drive that is cut off, shape ``(n_joints,)``.
        hold_angle: Angles at the trip, shape ``(n_joints,)``.
    """

    q: Array
    v: Array
    a: Array
    measured: Array
    decimated_angle: Array
    ring: Array
    rate: Array
    phase: Array
    entry_tick: Array
    debounce: Array
    blend_start: Array
    blended: Array
    signals: Array
    motor: Array
    external: Array
    assistance: Array
    lead: Array
    stride_start: Array
    stride_ticks: Array
    tracking: Array
    efforts: Array
    torque: Array
    passive: Array
    points: Array
    brace: Array
    works: Array
    changing: Array
    stage_q: Array
    stage_v: Array
    sum_v: Array
    sum_a: Array
    mean_v: Array
    angles: Array
    last_angle: Array
    last_fast: Array
    model_friction: Array
    control_q: Array
    control_a: Array
    gravity_torque: Array
    inertia_torque: Array
    legs: Array
    leg_ticks: Array
    before: Array
    switches: Array
    counters: Array
    watch_memory: Array
    watch_streaks: Array
    load_streaks: Array
    last_load: Array
    safety: Array
    drive_off: Array
    hold_angle: Array


class Episode(NamedTuple):
    """Inputs and state together, as the integrators hand them through.

    Attributes:
        inputs: What does not change.
        state: What does.
    """

    inputs: EpisodeInputs
    state: EpisodeState
