"""Measures of one leg of a run for the summary."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from twin_gait.core.actuator import torque_to_current
from twin_gait.gait.machine import POSTURE
from twin_gait.gait.table import TICK
from twin_gait.measures import effort, phases, strides, switching
from twin_gait.measures.foot_contact import find_scuffs, swing_clearances
from twin_gait.measures.load_shape import load_shape
from twin_gait.measures.strides import finite_mean
from twin_gait.measures.walk import mean_stride
from twin_gait.parameters.drives import ActuatorParameters
from twin_gait.report.reference import reference_cycle
from twin_gait.runs.leg_strides import LegStrides, StrideValues
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName

SETTLED_AFTER = 3  # number of strides after which a timeout is not due to the start of the walk


def continuous_current(actuator: ActuatorParameters) -> float:
    """Return the continuous current of a motor in [A]."""
    return torque_to_current(actuator.continuous_torque, actuator.torque_constant, actuator.gear_ratio)


def reference_error(run: Run, cycles: np.ndarray, joint: JointName) -> float:
    """Compute the RMS distance of strides from healthy walking in [deg]; NaN without strides or reference.

    ``cycles``: angles of the joint in [rad] at every percent of each stride, shape ``(n_strides, 101)``.
    """
    reference = reference_cycle(run.experiment, joint)
    if reference is None:
        return math.nan
    return math.degrees(strides.root_mean_square_error(cycles, reference))


def stride_means(values: StrideValues) -> dict[str, float]:
    """Return the means over strides by name."""
    return {name: finite_mean(each) for name, each in values.items()}


def _largest(values: np.ndarray) -> float:
    return float(values.max()) if len(values) else math.nan


def _largest_magnitude(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite[np.argmax(np.abs(finite))]) if len(finite) else math.nan


def saturated_shares(legs: Sequence["MeasuredLeg"]) -> dict[str, float]:
    """Compute the shares of the ticks at which motors of legs are at a limit, by their names in a summary.

    ``worst_joint_saturated_share``: share of the ticks with the joint at a limit, for the worst joint;
    ``any_joint_saturated_share``: share of the ticks in which at least one joint is at a limit.
    """
    cases = [joint["saturated"] for leg in legs for joint in leg.saturation_cases.values()]
    return {
        "worst_joint_saturated_share": max(map(effort.share_of_ticks, cases)),
        "any_joint_saturated_share": effort.share_of_ticks(np.any(cases, axis=0)),
    }


class MeasuredLeg(LegStrides):
    """Measures of one leg of a run by their names in a summary; NaN if not defined."""

    def summary(self, measures: Mapping[str, float] | None = None) -> dict[str, Any]:
        """Return gait and effort, with ``measures`` of a walk on a belt; None or NaN if not defined."""
        return {
            **self.contact_measures(),
            **self.phase_measures(),
            **({} if measures is None else {"load_pattern": self.load_pattern(), "walk": dict(measures)}),
            **self.error_parts(),
            "joints": {str(joint): self.joint_measures(joint) for joint in self.record.driven},
            **self.own_gait_measures(),
        }

    def own_gait_measures(self) -> dict[str, Any]:
        """Return motion and effort of the joints that the wearer moves; empty if the wearer moves none.

        The work in [J/kg of the wearer] is that of the muscles, as means over the counted strides.
        """
        patient, found = self.run.experiment.patient, dict[str, dict[str, float]]()
        for joint in self.record.angles:
            if joint in self.record.driven or patient is None:
                continue
            torque = self.column(joint, "own_torque_Nm")
            found[str(joint)] = {
                **stride_means(self.motion(self.record.angles[joint])),
                "torque_peak_Nm": _largest(np.abs(torque)),
                "torque_rms_Nm": effort.root_mean_square(torque),
                **stride_means(self.specific_work(torque * self.wearer_joint_velocity(joint), patient.mass)),
            }
        return {"own_gait": found} if found else {}

    def load_pattern(self) -> str:
        """Return ``two peaks``, or the reason why loading peak, trough and push-off peak are not defined."""
        force, walkway = self.record.normal_force, self.run.walkway
        assert force is not None and walkway is not None  # there is ground, and it carries weight
        return load_shape(mean_stride(force / walkway.carried_weight, self.strides)).pattern

    def brief_summary(self) -> dict[str, Any]:
        """Return the part of :meth:`summary` that a table of many runs contains."""
        return {
            **self.contact_measures(),
            "strides_by_phase": len(self.record.strides_by_phase(skip=0)),
            "phases_in_order": self.phases_in_order(),
            "timeouts": len(self.timeout_ticks()),
            "joints": {str(joint): self.effort(joint) for joint in self.record.driven},
        }

    def error_parts(self) -> dict[str, Any]:
        """Return the parts of the errors of hip, knee and ankle; empty without a healthy reference."""
        found = {}
        for joint, cycles in self.cycles.items():
            reference = reference_cycle(self.run.experiment, joint)
            if reference is not None:
                found[str(joint)] = strides.error_parts(cycles, reference)
        return {"errors": found} if found else {}

    def contact_measures(self) -> dict[str, Any]:
        """Return the measures of strides from heel strike to heel strike; None for each without ground."""
        record, contacts = self.record, self.record.contacts
        if contacts is None or record.clearance is None:
            return {"strides": None, "further_contacts": None}
        if self.run.trip is not None:  # in the hold the legs are lowered, not moved by the gait table
            contacts = contacts.truncate(self.run.trip.tick)
        lags = phases.entry_lags(record.first_phase_entries, contacts.heel_strikes, TICK)
        # A step at the start or the end of a walk may land in another phase.
        even = np.array([(span.start, span.stop) for span in record.steady_ticks], dtype=int).reshape(-1, 2)
        missed = np.isnan(lags) & strides.is_in_stride(contacts.heel_strikes, even)
        clearances = swing_clearances(record.clearance, contacts)
        times, both = strides.stride_times(self.strides, TICK), self.double_support()
        return {
            "strides": len(record.strides(skip=0)),
            "strides_counted": len(self.strides),
            "stride_time_mean_s": finite_mean(times),
            "stride_time_variation": strides.coefficient_of_variation(times),
            "swing_share": finite_mean(strides.swing_shares(self.strides, contacts.toe_offs)),
            "double_support_share": math.nan if both is None else finite_mean(both),
            **self._reference_errors("contact", self.cycles),
            "early_stance_lag_mean_s": finite_mean(lags),
            "early_stance_lag_max_abs_s": _largest_magnitude(lags),
            "heel_strikes_without_early_stance": int(missed.sum()),
            "toe_clearance_mean_m": finite_mean(clearances),
            "toe_clearance_min_m": -_largest(-clearances),
            "further_contacts": len(contacts.further_contacts),
            "scuffs": len(find_scuffs(contacts)),
        }

    def phase_measures(self) -> dict[str, Any]:
        """Return the measures of strides from one entry into the first phase to the next."""
        record = self.record
        counted, timeouts = record.strides_by_phase(skip=self.skip), self.timeout_ticks()
        since = int(counted[0, 0]) if len(counted) else len(record.phases)
        durations = phases.phase_durations(record.phases, TICK, since=since)
        settled = record.stride_events[SETTLED_AFTER:]
        return {
            "strides_by_phase": len(record.strides_by_phase(skip=0)),
            "strides_by_phase_counted": len(counted),
            "stride_time_by_phase_mean_s": finite_mean(strides.stride_times(counted, TICK)),
            **self._reference_errors("phase", self.normalise(record.angles, counted)),
            "phases_in_order": self.phases_in_order(),
            "phase_duration_mean_s": {
                name: finite_mean(durations.get(index, np.zeros(0)))
                for index, name in enumerate(self.table.phase_names)
            },
            "timeouts": len(timeouts),
            "timeouts_after_third_stride": sum(t >= settled[0] for t in timeouts) if len(settled) else None,
        }

    def _reference_errors(self, begin: str, cycles: Mapping[JointName, np.ndarray]) -> dict[str, float]:
        return {
            f"rmse_{joint}_by_{begin}_deg": reference_error(self.run, cycles[joint], joint)
            for joint in self.record.angles
        }

    def phases_in_order(self) -> bool:
        """Return whether the phases followed the order of the table's first cycle in steady walking."""
        record, names = self.record, self.table.phase_names
        cycle = (*self.table.cycles, names)[0]
        order = np.array([cycle.index(name) if name in cycle else -1 for name in names])
        sequences = (order[record.phase_sequence(span)] for span in record.steady_ticks)
        return all(phases.phases_in_order(sequence, len(cycle)) for sequence in sequences)

    def timeout_ticks(self) -> list[int]:
        """Return the ticks of the switches that a timeout caused."""
        clocked = {index for index, item in enumerate(self.run.table.transitions) if item.is_timeout}
        leg_switches = [item for item in self.run.switches if item.side is self.record.side]
        return [item.tick for item in leg_switches if item.transition in clocked and item.cause != POSTURE]

    def joint_measures(self, joint: JointName) -> dict[str, float]:
        """Return all measures of a driven joint."""
        return {
            **self.effort(joint),
            **stride_means(self.power(joint)),
            **self.torque_at_switches(joint),
            **stride_means(self.switch_energy(joint)),
            **self.jerk_rms(joint),
            **stride_means(self.jerk(joint)),
        }

    def effort(self, joint: JointName) -> dict[str, float]:
        """Return measures of the motion of a joint and of the effort of its motor."""
        actuator = self.run.experiment.plant.actuators[joint]
        found = {
            **stride_means(self.motion(self.record.angles[joint])),
            **effort.saturation_shares(self.saturation_cases[joint]),
        }
        for quantity, unit, values, continuous in (
            ("torque", "Nm", self.column(joint, "motor_torque_Nm"), actuator.continuous_torque),
            ("current", "A", self.column(joint, "measured_current_A"), continuous_current(actuator)),
        ):
            rms = effort.root_mean_square(values)
            found[f"{quantity}_peak_{unit}"], found[f"{quantity}_rms_{unit}"] = _largest(np.abs(values)), rms
            found[f"{quantity}_continuous_share"] = rms / continuous
        return found

    @cached_property
    def saturation_cases(self) -> dict[JointName, dict[str, np.ndarray]]:
        """Whether each motor is at a limit at every tick, see :func:`effort.saturation_cases`."""
        limits = self.run.experiment.control.limits
        return {
            joint: effort.saturation_cases(
                self.column(joint, "motor_command_torque_Nm"),
                self.column(joint, "target_current_A"),
                self.column(joint, "measured_current_A"),
                limits[joint],
            )
            for joint in self.record.driven
        }

    def torque_at_switches(self, joint: JointName) -> dict[str, float]:
        """Compute the changes of the command torque of a joint at the switches in the counted strides.

        ``switch_torque_jump_Nm`` is its largest change in one tick of a blend, ``switch_torque_change_Nm``
        its largest change from before a switch to any tick of the blend.
        """
        table, side, command = self.run.table, self.record.side, self.column(joint, "motor_command_torque_Nm")
        counted = [item for item in self.run.switches if item.side is side and 0 < item.tick < len(command)]
        blends = [(item.tick, table.blend_ticks(table.phases_of(side)[item.target])) for item in counted]
        ticks, lengths = np.array(blends, int).reshape(-1, 2).T
        counts = strides.is_in_stride(ticks, self.strides)
        ticks, lengths = ticks[counts], lengths[counts]
        windows = switching.blend_windows(ticks, lengths, len(command))
        return {
            "switch_torque_jump_Nm": _largest(switching.torque_jumps(command, windows)),
            "switch_torque_change_Nm": _largest(effort.changes_at_switches(command, ticks, lengths)),
        }

    def jerk_rms(self, joint: JointName) -> dict[str, float]:
        """Compute the RMS of the jerk of a joint over the counted strides."""
        jerk = switching.joint_jerk(self.wearer_joint_velocity(joint), TICK)
        return {"jerk_rms_rad_per_s3": effort.root_mean_square(strides.values_in_strides(jerk, self.strides))}
