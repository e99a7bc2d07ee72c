"""One run of a comparison in numbers: gait, torque between device and leg, work, effort of the motors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pandas as pd

from twin_gait.core.actuator import torque_to_current
from twin_gait.experiment import ControlMode
from twin_gait.gait.table import TICK
from twin_gait.measures.effort import (
    battery_life,
    interaction_torque,
    load,
    opposing_torque,
    positive_work,
    root_mean_square,
    share_of_work,
)
from twin_gait.measures.foot_contact import CONTACT_FORCE, scuffs, swing_clearances
from twin_gait.measures.leg_record import LegRecord, wearer_column
from twin_gait.measures.phases import phase_spells
from twin_gait.measures.reference import gait_profile_score, gait_variable_score
from twin_gait.measures.strides import (
    PERCENT,
    cadence,
    double_support_share,
    normalise_strides,
    step_times,
    stride_extremes,
    stride_lengths,
    stride_times,
    swing_shares,
    symmetry_index,
)
from twin_gait.measures.switching import dimensionless_jerk, joint_jerk
from twin_gait.replay.normative import WINTER, normative_walk
from twin_gait.report.reference import reference_cycle
from twin_gait.runs.leg_summary import blend_length
from twin_gait.runs.record import belt_speed_of
from twin_gait.scenario import TreadmillScenario
from twin_gait.simulation.run import Run
from twin_gait.studies.compare.wearer_torque import voluntary_torque
from twin_gait.vocabulary import MOTOR_JOINTS, JointName, Outcome, Side

LEAST_STRIDES = 2  # a leg that has made fewer after the first two has not walked

Numbers = dict[str, float]


class _Leg(NamedTuple):
    """A leg with the strides that count, and the ticks that they span."""

    record: LegRecord
    strides: np.ndarray
    span: slice


def numbers_of(run: Run) -> Numbers:
    """All numbers of a run, by names with their units.

    ``walked`` is 1 for a run whose verdict is so; of any other, the gait has no numbers but ``walked_s``.

    Args:
        run: A run on the treadmill.

    Returns:
        Numbers by name; NaN where one is not defined.
    """
    end = len(run.log) if run.trip is None else run.trip.tick
    walked = run.verdict.outcome is Outcome.WALKED
    numbers: Numbers = {"walked": float(walked), "walked_s": end * TICK}
    legs = {side: _leg(run, side) for side in run.sides}
    if not walked or any(len(leg.strides) < LEAST_STRIDES for leg in legs.values()):
        return numbers
    for side, leg in legs.items():
        other = next(item for name, item in legs.items() if name is not side)
        numbers |= {f"{side}_{name}": value for name, value in _gait(run, leg, other).items()}
        for joint in MOTOR_JOINTS:
            found = {**_shape(run, leg, joint), **_effort(run, leg, joint)}
            numbers |= {f"{side}_{joint}_{name}": value for name, value in found.items()}
    return {**numbers, **_together(run, numbers)}


def _leg(run: Run, side: Side) -> _Leg:
    record = run.leg_record(side)
    strides = record.strides()
    span = slice(int(strides[0, 0]), int(strides[-1, 1])) if len(strides) else slice(0, 0)
    return _Leg(record, strides, span)


def _gait(run: Run, leg: _Leg, other: _Leg) -> Numbers:
    record, contacts, others = leg.record, leg.record.contacts, other.record.contacts
    assert contacts is not None and others is not None  # there is a belt
    assert record.normal_force is not None and record.clearance is not None
    assert other.record.normal_force is not None
    times = stride_times(leg.strides, TICK)
    clearance = swing_clearances(record.clearance, contacts)
    strikes = contacts.heel_strikes[contacts.heel_strikes >= leg.span.start]
    return {
        "strides": float(len(leg.strides)),
        "stride_time_s": float(times.mean()),
        "cadence_per_min": cadence(times),
        "stride_length_m": float(stride_lengths(times, belt_speed_of(run.experiment)).mean()),
        "step_time_s": _mean(step_times(strikes, others.heel_strikes, TICK)),
        "swing_share": _mean(swing_shares(leg.strides, contacts.toe_offs)),
        "double_support_share": double_support_share(
            record.normal_force, other.record.normal_force, leg.strides, CONTACT_FORCE
        ),
        "toe_clearance_m": float(clearance.min()) if len(clearance) else math.nan,
        "scuffs": float(len(scuffs(contacts))),
    }


def _mean_belt_speed(run: Run) -> float:
    """Speed of the belt in [m] / [s], over the whole run if it starts and stops; a walk has no trip."""
    scenario = run.experiment.scenario
    assert isinstance(scenario, TreadmillScenario)  # there is a belt
    if scenario.belt is None:
        return scenario.belt_speed
    return scenario.belt_travel(len(run.log) * TICK) / (len(run.log) * TICK)


def _mean(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else math.nan


def _shape(run: Run, leg: _Leg, joint: JointName) -> Numbers:
    """Range of motion, distance from healthy gait, smoothness."""
    angle, strides = leg.record.angles[joint], leg.strides
    extremes = np.degrees(stride_extremes(angle, strides))
    cycles = np.degrees(normalise_strides(angle, strides))
    velocity = run.log[wearer_column(run.log, leg.record.side, joint, "velocity_rad_per_s")].to_numpy()
    jerk = dimensionless_jerk(velocity, joint_jerk(velocity, TICK), strides, TICK)
    reference = reference_cycle(run.experiment, joint)
    return {
        "range_of_motion_deg": float(np.mean(extremes[:, 1] - extremes[:, 0])),
        "gvs_koopman_deg": math.nan
        if reference is None
        else gait_variable_score(cycles, np.degrees(reference)),
        "gvs_winter_deg": gait_variable_score(cycles, np.degrees(winter_cycle(joint))),
        # The logarithm is after Balasubramanian et al. (2015); nearer to 0 is smoother.
        "smoothness": -math.log(float(np.nanmean(jerk))),
    }


def winter_cycle(joint: JointName) -> np.ndarray:
    """Angle of healthy walking at natural cadence (Winter 1991).

    Args:
        joint: Hip or knee.

    Returns:
        Angles in [rad] at ``PERCENT``, shape ``(101,)``.
    """
    walk = normative_walk(WINTER, strides=2)
    angles = walk.recording.angles[Side.LEFT][str(joint)]
    return np.asarray(np.interp(PERCENT / 100.0 * walk.cycle_time, np.arange(len(angles)) * TICK, angles))


def _effort(run: Run, leg: _Leg, joint: JointName) -> Numbers:
    """Torques, work and current of a joint over the strides that count."""
    side, span = leg.record.side, leg.span
    log, actuator = run.log.iloc[span], run.experiment.plant.actuators[joint]
    name = f"{side}_{joint}"
    # What acts on the wearer works on his own motion, which with braces is not that of the device.
    velocity = log[wearer_column(log, side, joint, "velocity_rad_per_s")].to_numpy()
    device = _device_torque(log, name, actuator.armature)
    effort = voluntary_torque(run, side, joint)[span]
    continuous = torque_to_current(
        actuator.continuous_torque, actuator.torque_constant, actuator.gear_ratio, actuator.gear_efficiency
    )
    current = load(log[f"{name}_measured_current_A"].to_numpy(), continuous)
    return {
        "interaction_rms_Nm": root_mean_square(device),
        "effort_rms_Nm": root_mean_square(effort),
        "opposing_rms_Nm": root_mean_square(opposing_torque(device, effort)),
        "device_work_J": positive_work(device, velocity, TICK),
        "wearer_work_J": positive_work(effort, velocity, TICK),
        "help_share": help_share(run, side, joint, (span.start + span.stop) // 2),
        "current_rms_A": current.rms,
        "current_rms_share": current.continuous_share,
    }


def _device_torque(log: pd.DataFrame, name: str, rotor_inertia: float) -> np.ndarray:
    """What the device does on the wearer: the torque of the brace, or without one that behind the gear."""
    if f"{name}_brace_torque_Nm" in log:
        return log[f"{name}_brace_torque_Nm"].to_numpy()
    return interaction_torque(
        log[f"{name}_motor_torque_Nm"].to_numpy(),
        log[f"{name}_friction_torque_Nm"].to_numpy(),
        log[f"{name}_velocity_rad_per_s"].to_numpy(),
        rotor_inertia,
        TICK,
    )


def help_share(run: Run, side: Side, joint: JointName, since: int) -> float:
    """Share of the stiffness of its phases that a joint was given: in full 1, without springs 0.

    Args:
        run: The run.
        side: The leg.
        joint: Hip or knee.
        since: Stays in a phase that begin before this tick do not count.

    Returns:
        Mean over the ends of the stays in a phase, where no blend is under way; NaN if there is none.
        Of help that adapts, the first strides say how it began and not where it leads.
    """
    control = run.experiment.control
    if control.mode in (ControlMode.TRANSPARENT, ControlMode.GRAVITY):
        return 0.0
    if control.mode is not ControlMode.IMPEDANCE:
        return control.assistance.share[joint]
    phases = [run.table.phases_of(side)[name] for name in run.table.phase_names]
    codes = run.leg_record(side).phases
    given = run.log[f"{side}_{joint}_stiffness_Nm_per_rad"].to_numpy()
    shares = []
    for spell in phase_spells(codes)[1:-1]:
        asked = phases[spell.phase].joints[str(joint)].stiffness
        settled = spell.end - spell.start > blend_length(run.table.blending)
        if spell.start >= since and settled and asked > 0.0:
            shares.append(given[spell.end - 1] / asked)
    return _mean(np.array(shares))


def _together(run: Run, numbers: Numbers) -> Numbers:
    """What the numbers of both legs come to."""

    def every(name: str, joints: tuple[JointName, ...] = MOTOR_JOINTS) -> list[float]:
        return [numbers[f"{side}_{joint}_{name}"] for side in run.sides for joint in joints]

    def both(name: str) -> list[float]:
        return [numbers[f"{side}_{name}"] for side in run.sides]

    power = float(run.log["battery_power_W"].mean())
    device, wearer = sum(every("device_work_J")), sum(every("wearer_work_J"))
    together = {
        name: float(np.mean(both(name)))
        for name in (
            "stride_time_s",
            "cadence_per_min",
            "stride_length_m",
            "swing_share",
            "double_support_share",
        )
    }
    return {
        **together,
        "toe_clearance_m": min(both("toe_clearance_m")),
        "scuffs": sum(both("scuffs")),
        **{
            f"{joint}_{name}": float(np.mean(every(name, (joint,))))
            for joint in MOTOR_JOINTS
            for name in _PER_JOINT
        },
        "gps_koopman_deg": gait_profile_score(every("gvs_koopman_deg")),
        "gps_winter_deg": gait_profile_score(every("gvs_winter_deg")),
        "step_time_symmetry": symmetry_index(*both("step_time_s")),
        "swing_symmetry": symmetry_index(*both("swing_share")),
        "knee_range_symmetry": symmetry_index(*every("range_of_motion_deg", (JointName.KNEE,))),
        "hip_range_symmetry": symmetry_index(*every("range_of_motion_deg", (JointName.HIP,))),
        "interaction_symmetry": symmetry_index(
            *(
                sum(numbers[f"{side}_{joint}_interaction_rms_Nm"] for joint in MOTOR_JOINTS)
                for side in run.sides
            )
        ),
        "interaction_rms_Nm": root_mean_square(np.array(every("interaction_rms_Nm"))),
        "opposing_rms_Nm": root_mean_square(np.array(every("opposing_rms_Nm"))),
        "effort_rms_Nm": root_mean_square(np.array(every("effort_rms_Nm"))),
        "wearer_work_share": share_of_work(wearer, device),
        "help_share": float(np.mean(every("help_share"))),
        "smoothness": float(np.mean(every("smoothness"))),
        "current_rms_share": max(every("current_rms_share")),
        "battery_power_W": power,
        "battery_life_h": battery_life(run.experiment.plant.battery.energy, power) / 3600.0,
        "energy_per_metre_J": power / _mean_belt_speed(run),
    }


_PER_JOINT = ("range_of_motion_deg", "interaction_rms_Nm", "opposing_rms_Nm", "help_share", "gvs_koopman_deg")
