"""Measures of one run of a comparison: gait, torque between device and leg, work, load of the motors."""

import math

import numpy as np
import pandas as pd

from twin_gait.gait.table import TICK
from twin_gait.measures import effort, strides
from twin_gait.measures.ground_strides import ground_speeds
from twin_gait.measures.phases import phase_spells
from twin_gait.measures.reference import gait_profile_score, gait_variable_score
from twin_gait.measures.walk import wearer_powers
from twin_gait.report.reference import reference_cycle
from twin_gait.runs.leg_summary import MeasuredLeg, continuous_current
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName, Outcome, Side

LEAST_STRIDES = 2  # a leg with fewer strides after the first two has not walked

Measures = dict[str, float]


def run_measures(run: Run) -> Measures:
    """Compute all measures of a run, by names with their units; NaN if one is not defined.

    ``walked`` is 1 for a run with this verdict; any other run has no measures of the gait except
    ``walked_s``.
    """
    end = len(run.columns) if run.trip is None else run.trip.tick
    walked = run.verdict.outcome is Outcome.WALKED
    found: Measures = {"walked": float(walked), "walked_s": end * TICK}
    legs = [MeasuredLeg(run, record) for record in run.leg_records()]
    if not walked or any(len(leg.strides) < LEAST_STRIDES for leg in legs):
        return found
    pairs = zip(legs, reversed(legs), strict=True)
    by_owner = {str(leg.record.side): _gait(leg, other) for leg, other in pairs}
    by_leg = pd.DataFrame(by_owner).T
    shapes = {(leg.record.side, joint): _shape(leg, joint) for leg in legs for joint in leg.record.angles}
    efforts = {(leg.record.side, joint): _effort(leg, joint) for leg in legs for joint in leg.record.driven}
    by_owner |= {f"{key[0]}_{key[1]}": {**shapes[key], **efforts.get(key, {})} for key in shapes}
    by_joint, by_drive = pd.DataFrame(shapes).T, pd.DataFrame(efforts).T
    for rows_of_all in (by_joint, by_drive):
        for joint, rows in rows_of_all.groupby(level=1):
            by_owner[str(joint)] = {**by_owner.get(str(joint), {}), **_means(rows)}
    found |= {f"{owner}_{name}": value for owner, row in by_owner.items() for name, value in row.items()}
    powers = pd.DataFrame([wearer_powers(run.columns, leg.record, leg.strides) for leg in legs]).sum(
        skipna=False
    )
    return {**found, **_together(run, by_leg, by_joint, by_drive), **powers}


def _means(rows: pd.DataFrame) -> Measures:
    """Compute the means of columns; NaN if a row has no value."""
    return {str(name): float(value) for name, value in rows.mean(skipna=False).items()}


def _gait(leg: MeasuredLeg, other: MeasuredLeg) -> Measures:
    known, times = leg.contact_measures(), strides.stride_times(leg.strides, TICK)
    assert other.record.contacts is not None  # a run on the ground has contacts
    steps = strides.step_times(leg.strides, other.record.contacts.heel_strikes, TICK)
    return {
        "stride_time_s": known["stride_time_mean_s"],
        "stride_length_m": strides.finite_mean(ground_speeds(leg.log, leg.strides, TICK) * times),
        "step_time_s": strides.finite_mean(steps),
        "double_support_share": known["double_support_share"],
        "toe_clearance_m": known["toe_clearance_min_m"],
    }


def _shape(leg: MeasuredLeg, joint: JointName) -> Measures:
    """Compute range of motion, deviation from healthy gait, and smoothness."""
    cycles, motion = np.degrees(leg.cycles[joint]), leg.motion(leg.record.angles[joint])
    reference = reference_cycle(leg.run.experiment, joint)
    koopman = math.nan if reference is None else gait_variable_score(cycles, np.degrees(reference))
    return {
        "range_of_motion_deg": strides.finite_mean(motion["range_of_motion_deg"]),
        "gvs_koopman_deg": koopman,
        # The logarithm follows Balasubramanian et al. (2015); a value closer to 0 is smoother.
        "smoothness": -math.log(strides.finite_mean(leg.jerk(joint)["jerk_dimensionless"])),
    }


def _effort(leg: MeasuredLeg, joint: JointName) -> Measures:
    """Compute torques, work and current of a joint over the counted strides."""
    run, side = leg.run, leg.record.side
    actuator = run.experiment.plant.actuators[joint]
    device, voluntary, flowing = (
        strides.values_in_strides(values, leg.strides)
        for values in (
            leg.device_torque(joint),
            leg.column(joint, "voluntary_torque_Nm"),
            leg.column(joint, "measured_current_A"),
        )
    )
    current = effort.root_mean_square(flowing)
    half_way = int(leg.strides[0, 0] + leg.strides[-1, 1]) // 2
    return {
        "interaction_rms_Nm": effort.root_mean_square(device),
        "effort_rms_Nm": effort.root_mean_square(voluntary),
        "opposing_rms_Nm": effort.root_mean_square(effort.opposing_torque(device, voluntary)),
        **{name: float(values.sum()) for name, values in leg.work(joint).items()},
        "assistance_level": assistance_level(run, side, joint, half_way),
        "current_rms_A": current,
        "current_rms_share": current / continuous_current(actuator),
    }


def assistance_level(run: Run, side: Side, joint: JointName, since: int) -> float:
    """Compute the applied fraction of the stiffness of the phases of a joint: 1 in full, 0 without springs.

    The mean is taken over the ends of the stays in a phase at which no blend is active; NaN if there is none.
    If the assistance adapts, the first strides show its initial and not its final level: stays before tick
    ``since`` are not counted.
    """
    control = run.experiment.control
    if control.mode in ("transparent", "gravity"):
        return 0.0
    if control.mode not in ("impedance", "policy"):
        return control.assistance.share.get(joint, 1.0)
    phases = [run.table.phases_of(side)[name] for name in run.table.phase_names]
    codes = run.leg_record(side).phases
    given = np.asarray(run.columns[f"{side}_{joint}_stiffness_Nm_per_rad"])
    shares = []
    for spell in phase_spells(codes)[1:-1]:
        prescribed = phases[spell.phase].joints[str(joint)].stiffness
        settled = spell.end - spell.start > run.table.blend_ticks(phases[spell.phase])
        if spell.start >= since and settled and prescribed > 0.0:
            shares.append(given[spell.end - 1] / prescribed)
    return strides.finite_mean(np.array(shares))


def _together(run: Run, by_leg: pd.DataFrame, by_joint: pd.DataFrame, by_drive: pd.DataFrame) -> Measures:
    """Compute the measures of both legs together; most are the mean of the legs.

    Rows of ``by_joint`` are all joints, rows of ``by_drive`` those with a drive. The symmetry of the torques
    of the device is NaN for a device on one leg.
    """
    log, power = run.columns, float(np.asarray(run.columns["battery_power_W"]).mean())
    ranges = by_joint["range_of_motion_deg"].unstack()
    work = by_drive[["wearer_work_J", "device_work_J"]].sum(skipna=False)
    torques = by_drive["interaction_rms_Nm"].unstack().sum(axis=1)
    rms = ("interaction_rms_Nm", "opposing_rms_Nm", "effort_rms_Nm")
    return {
        **_means(by_leg),
        "toe_clearance_m": by_leg["toe_clearance_m"].min(skipna=False),
        "gps_koopman_deg": gait_profile_score(by_joint["gvs_koopman_deg"].tolist()),
        "step_time_symmetry": strides.symmetry_index(*by_leg["step_time_s"]),
        **{f"{joint}_range_symmetry": strides.symmetry_index(*ranges[joint]) for joint in ranges},
        "interaction_symmetry": strides.symmetry_index(*torques) if len(torques) == len(by_leg) else math.nan,
        **{name: effort.root_mean_square(by_drive[name].to_numpy()) for name in rms},
        "wearer_work_share": effort.share_of_work(*work),
        **_means(by_drive[["assistance_level"]]),
        **_means(by_joint[["smoothness"]]),
        "current_rms_share": by_drive["current_rms_share"].max(),
        "battery_power_W": power,
        "battery_life_h": effort.battery_life(run.experiment.plant.battery.energy, power) / 3600.0,
        "energy_per_metre_J": power / float(ground_speeds(log, np.array([[0, len(log)]]), TICK)[0]),
    }
