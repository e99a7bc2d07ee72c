"""One leg of a run in numbers, for the summary."""

import math
from typing import Any

import numpy as np

from twin_gait.core.actuator import torque_to_current
from twin_gait.gait.machine import POSTURE
from twin_gait.gait.table import TICK
from twin_gait.measures import switching
from twin_gait.measures.effort import Load, changes_at_switches, load, saturation_shares
from twin_gait.measures.foot_contact import scuffs, swing_clearances
from twin_gait.measures.leg_record import LegRecord, wearer_column
from twin_gait.measures.phases import entry_lags, phase_durations, phases_in_order
from twin_gait.measures.strides import (
    SKIPPED_STRIDES,
    coefficient_of_variation,
    error_parts,
    finite_mean,
    in_strides,
    normalise_strides,
    root_mean_square_error,
    stride_extremes,
    stride_times,
    swing_shares,
)
from twin_gait.measures.walk import WalkMeasures
from twin_gait.parameters import ActuatorParameters
from twin_gait.report.reference import reference_cycle
from twin_gait.report.walk_words import summary_of_errors, summary_of_leg
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName, Side

SETTLED_AFTER = 3  # strides; a time-out later than that is no longer the start's


def summarise_side(
    run: Run, record: LegRecord, skip: int, measures: WalkMeasures | None = None
) -> dict[str, Any]:
    """Gait and effort of one leg, with ``measures`` of the walk on a belt; None or NaN if not defined."""
    return {
        **by_contact(run, record, skip),
        **_by_phase(run, record, skip),
        **({} if measures is None else {"walk": summary_of_leg(measures)}),
        **_errors(run, record, skip),
        "joints": {
            str(joint): {
                **_effort(run, record, joint, skip),
                **_work(run, record, joint, skip),
                **torque_at_switches(run, record, joint, skip),
                **_energy_at_switches(run, record, joint, skip),
                **_jerk(run, record, joint, skip),
            }
            for joint in record.angles
        },
    }


def compared_angles(run: Run, record: LegRecord) -> dict[JointName, np.ndarray]:
    """Angles that healthy walking has too: of the driven joints, and of the ankle where the leg has one."""
    ankle = wearer_column(run.log, record.side, JointName.ANKLE, "angle_rad")
    return {**record.angles, **({JointName.ANKLE: run.log[ankle].to_numpy()} if ankle in run.log else {})}


def _errors(run: Run, record: LegRecord, skip: int) -> dict[str, Any]:
    """Distance of hip, knee and ankle from healthy walking, in parts; nothing without a reference."""
    strides, found = record.strides(skip=skip), {}
    for joint, angles in compared_angles(run, record).items():
        reference = reference_cycle(run.experiment, joint)
        if reference is not None:
            parts = error_parts(normalise_strides(angles, strides), reference)
            found[str(joint)] = summary_of_errors(parts)
    return {"errors": found} if found else {}


def side_in_brief(run: Run, side: Side) -> dict[str, Any]:
    """The part of :func:`summarise_side` that a table of many runs holds."""
    record = run.leg_record(side)
    return {
        **by_contact(run, record, SKIPPED_STRIDES),
        "strides_by_phase": len(record.strides_by_phase(skip=0)),
        "phases_in_order": _in_order(run, record),
        "time_outs": len(_time_out_ticks(run, record)),
        "joints": {str(joint): _effort(run, record, joint, SKIPPED_STRIDES) for joint in record.angles},
    }


def _largest(values: np.ndarray) -> float:
    return float(values.max()) if len(values) else math.nan


def _largest_magnitude(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite[np.argmax(np.abs(finite))]) if len(finite) else math.nan


def by_contact(run: Run, record: LegRecord, skip: int) -> dict[str, Any]:
    """What strides from heel strike to heel strike tell; None without ground."""
    contacts = record.contacts
    if contacts is None or record.clearance is None:
        return {"strides": None, "further_contacts": None}
    every, counted = record.strides(skip=0), record.strides(skip=skip)
    lags = entry_lags(record.entries, contacts.heel_strikes, TICK)
    clearances = swing_clearances(record.clearance, contacts)
    return {
        "strides": len(every),
        "strides_counted": len(counted),
        "stride_time_mean_s": finite_mean(stride_times(counted, TICK)),
        "stride_time_variation": coefficient_of_variation(stride_times(counted, TICK)),
        "swing_share": finite_mean(swing_shares(counted, contacts.toe_offs)),
        **{
            f"rmse_{joint}_by_contact_deg": reference_error(run, angles, joint, counted)
            for joint, angles in record.angles.items()
        },
        "early_stance_lag_mean_s": finite_mean(lags),
        "early_stance_lag_largest_s": _largest_magnitude(lags),
        "heel_strikes_without_early_stance": int(np.isnan(lags).sum()),
        "toe_clearance_mean_m": finite_mean(clearances),
        "toe_clearance_least_m": -_largest(-clearances),
        "further_contacts": len(contacts.further_contacts),
        "scuffs": len(scuffs(contacts)),
    }


def _by_phase(run: Run, record: LegRecord, skip: int) -> dict[str, Any]:
    """What strides from one entry into the first phase to the next tell."""
    every, counted = record.strides_by_phase(skip=0), record.strides_by_phase(skip=skip)
    since = int(counted[0, 0]) if len(counted) else len(record.phases)
    names = run.table.phase_names
    durations = phase_durations(record.phases, TICK, since=since)
    return {
        "strides_by_phase": len(every),
        "strides_by_phase_counted": len(counted),
        "stride_time_by_phase_mean_s": finite_mean(stride_times(counted, TICK)),
        "stride_time_by_phase_variation": coefficient_of_variation(stride_times(counted, TICK)),
        **{
            f"rmse_{joint}_by_phase_deg": reference_error(run, angles, joint, counted)
            for joint, angles in record.angles.items()
        },
        "phases_in_order": _in_order(run, record),
        "phase_duration_mean_s": {
            name: finite_mean(durations.get(index, np.zeros(0))) for index, name in enumerate(names)
        },
        **_time_outs(run, record),
    }


def _in_order(run: Run, record: LegRecord) -> bool:
    """Whether the phases of the first cycle of the table followed each other while the leg walked evenly."""
    cycle = (*run.table.cycles, run.table.phase_names)[0]
    places = np.array([cycle.index(name) if name in cycle else -1 for name in run.table.phase_names])
    times = np.arange(len(record.phases)) * TICK
    steady = (times >= record.steady[0]) & (times < record.steady[1])
    return phases_in_order(places[record.phases[steady]], len(cycle))


def _time_out_ticks(run: Run, record: LegRecord) -> list[int]:
    return [
        switch.tick
        for switch in run.switches
        if switch.side is record.side
        and switch.cause != POSTURE
        and run.table.transitions[switch.transition].is_time_out
    ]


def _time_outs(run: Run, record: LegRecord) -> dict[str, Any]:
    ticks = _time_out_ticks(run, record)
    events = record.stride_events
    later = None
    if len(events) > SETTLED_AFTER:
        later = sum(tick >= events[SETTLED_AFTER] for tick in ticks)
    return {"time_outs": len(ticks), "time_outs_after_third_stride": later}


def reference_error(run: Run, angles: np.ndarray, joint: JointName, bounds: np.ndarray) -> float:
    """RMS distance of a joint's strides from healthy walking in [deg]; NaN without strides or reference.

    ``angles`` of the joint in [rad], one a tick; ``bounds``: its strides, shape ``(n_strides, 2)``.
    """
    reference = reference_cycle(run.experiment, joint)
    if reference is None:
        return math.nan
    return math.degrees(root_mean_square_error(normalise_strides(angles, bounds), reference))


def _effort(run: Run, record: LegRecord, joint: JointName, skip: int) -> dict[str, Any]:
    """Motion and effort of one joint."""
    name, actuator = f"{record.side}_{joint}", run.experiment.plant.actuators[joint]
    torque, current = actuator.continuous_torque, continuous_current(actuator)
    return {
        **joint_motion(record, joint, skip),
        **joint_saturation(run, record, joint),
        **_load("torque", "Nm", load(run.log[f"{name}_motor_torque_Nm"].to_numpy(), torque)),
        **_load("current", "A", load(run.log[f"{name}_measured_current_A"].to_numpy(), current)),
    }


def continuous_current(actuator: ActuatorParameters) -> float:
    """Current that a motor can hold in [A]."""
    return torque_to_current(actuator.continuous_torque, actuator.torque_constant, actuator.gear_ratio)


def _load(quantity: str, unit: str, found: Load) -> dict[str, float]:
    return {
        f"{quantity}_peak_{unit}": found.peak,
        f"{quantity}_rms_{unit}": found.rms,
        f"{quantity}_continuous_share": found.continuous_share,
    }


def _work(run: Run, record: LegRecord, joint: JointName, skip: int) -> dict[str, float]:
    """What a motor does at its joint, means over the counted strides; work is per mass of the wearer."""
    name, log, strides = f"{record.side}_{joint}", run.log, record.strides(skip=skip)
    power = (log[f"{name}_motor_torque_Nm"] * log[f"{name}_velocity_rad_per_s"]).to_numpy()
    mass = math.nan if run.experiment.patient is None else run.experiment.patient.mass
    given, taken = (
        switching.sums_over(part, strides) for part in (np.maximum(power, 0.0), np.minimum(power, 0.0))
    )
    return {
        "power_peak_W": finite_mean(stride_extremes(power, strides)[:, 1]),
        "positive_work_J_per_kg": TICK * finite_mean(given) / mass,
        "negative_work_J_per_kg": TICK * finite_mean(taken) / mass,
    }


def joint_motion(record: LegRecord, joint: JointName, skip: int) -> dict[str, float]:
    """Means over the counted strides of range, lowest and highest angle of a joint."""
    extremes = np.degrees(stride_extremes(record.angles[joint], record.strides(skip=skip)))
    return {
        "range_of_motion_deg": finite_mean(extremes[:, 1] - extremes[:, 0]),
        "lowest_deg": finite_mean(extremes[:, 0]),
        "peak_deg": finite_mean(extremes[:, 1]),
    }


def joint_saturation(run: Run, record: LegRecord, joint: JointName) -> dict[str, float]:
    """Shares of the time in which a motor is at a limit."""
    name, log, limits = f"{record.side}_{joint}", run.log, run.experiment.control.limits
    saturation = saturation_shares(
        log[f"{name}_motor_command_torque_Nm"].to_numpy(),
        log[f"{name}_target_current_A"].to_numpy(),
        log[f"{name}_measured_current_A"].to_numpy(),
        torque_limit=limits.torque,
        current_limit=limits.current,
    )
    return {f"{name}_share": share for name, share in saturation._asdict().items()}


def torque_at_switches(run: Run, record: LegRecord, joint: JointName, skip: int) -> dict[str, float]:
    """What the switches in the counted strides do to the commanded torque of a joint.

    ``switch_torque_jump_Nm`` is its largest change in one tick of a blend, and ``switch_torque_change_Nm``
    the largest from before a switch to any tick of its blend.
    """
    phases = run.table.phases_of(record.side)
    switches = [item for item in run.switches if item.side is record.side and 0 < item.tick < len(run.log)]
    blends = [(item.tick, run.table.blend_ticks(phases[item.target])) for item in switches]
    ticks, lengths = np.array(blends, int).reshape(-1, 2).T
    counts = in_strides(ticks, record.strides(skip=skip))
    counted, lengths = ticks[counts], lengths[counts]
    command = run.log[f"{record.side}_{joint}_motor_command_torque_Nm"].to_numpy()
    return {
        "switch_torque_jump_Nm": _largest(
            switching.torque_jumps(command, switching.blend_windows(counted, lengths, len(command)))
        ),
        "switch_torque_change_Nm": _largest(changes_at_switches(command, counted, lengths)),
    }


def _energy_at_switches(run: Run, record: LegRecord, joint: JointName, skip: int) -> dict[str, float]:
    """What the switches put into the virtual spring of a joint, means over strides.

    ``switch_energy_J`` is that on balance, and ``switch_energy_put_in_J`` leaves out the ticks in which they
    take energy out. They are of the spring that the gait table asks for, also where a limit or another
    controller keeps the motor from acting like it.
    """
    name, log, strides = f"{record.side}_{joint}", run.log, record.strides(skip=skip)
    energy = switching.switching_energy(
        log[f"{name}_measured_angle_rad"].to_numpy(),
        log[f"{name}_stiffness_Nm_per_rad"].to_numpy(),
        log[f"{name}_equilibrium_rad"].to_numpy(),
    )
    return {
        "switch_energy_J": finite_mean(switching.sums_over(energy, strides)),
        "switch_energy_put_in_J": finite_mean(switching.sums_over(np.maximum(energy, 0.0), strides)),
    }


def _jerk(run: Run, record: LegRecord, joint: JointName, skip: int) -> dict[str, float]:
    """Jerk of a joint over the counted strides, filtered as :mod:`twin_gait.measures.switching` says."""
    velocity = run.log[wearer_column(run.log, record.side, joint, "velocity_rad_per_s")].to_numpy()
    strides, jerk = record.strides(skip=skip), switching.joint_jerk(velocity, TICK)
    ticks = (strides[:, 1] - strides[:, 0]).sum()
    squared = switching.sums_over(jerk * jerk, strides).sum()
    return {
        "jerk_rms_rad_per_s3": math.sqrt(squared / ticks) if ticks else math.nan,
        "jerk_dimensionless": finite_mean(switching.dimensionless_jerk(velocity, jerk, strides, TICK)),
    }
