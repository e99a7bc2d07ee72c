"""Strides of one leg of a run: every quantity of each stride, under the names in ``strides.csv``.

Means over strides in a summary are means of these values.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures import effort, phases, strides, switching
from twin_gait.measures.ground_strides import ground_speeds, ground_strides
from twin_gait.measures.leg_record import LegRecord, LogColumns, wearer_column
from twin_gait.measures.walk import OWN_GAIT, fore_aft_peaks, load_measures
from twin_gait.report.reference import reference_cycle
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName

# Values of each stride by name, shape ``(n_strides,)``; NaN where a value is not defined.
StrideValues = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class LegStrides:
    """Counted strides of one leg of a run."""

    run: Run
    record: LegRecord
    skip: int = strides.SKIPPED_STRIDES  # number of strides at the start that are not counted

    @cached_property
    def log(self) -> LogColumns:
        """Columns of the log of the run."""
        return self.run.columns

    @cached_property
    def strides(self) -> np.ndarray:
        """Bounds of the counted strides, see :meth:`LegRecord.strides`."""
        return self.record.strides(skip=self.skip)

    @property
    def table(self) -> GaitTable:
        """Gait table whose phases the leg has."""
        return self.run.leg_table(self.record.side)

    @property
    def other(self) -> LegRecord | None:
        """Record of the other leg; None for a single leg."""
        return next((item for item in self.run.leg_records() if item.side is not self.record.side), None)

    def column(self, joint: JointName, quantity: str) -> np.ndarray:
        """Return the column of the log with a quantity of a joint at every tick."""
        return np.asarray(self.log[f"{self.record.side}_{joint}_{quantity}"])

    def wearer_joint_velocity(self, joint: JointName) -> np.ndarray:
        """Return the velocity of the wearer's joint at every tick in [rad/s]."""
        name = wearer_column(self.log, self.record.side, joint, "velocity_rad_per_s")
        return np.asarray(self.log[name])

    @cached_property
    def reference_joint_angles(self) -> dict[JointName, np.ndarray]:
        """Angles with a healthy reference [rad]: of the moved joints, and of the wearer's ankle."""
        log, angles = self.log, dict(self.record.angles)
        ankle = wearer_column(log, self.record.side, JointName.ANKLE, "angle_rad")
        return angles | ({JointName.ANKLE: np.asarray(log[ankle])} if ankle in log else {})

    @cached_property
    def cycles(self) -> dict[JointName, np.ndarray]:
        """Angles of :attr:`reference_joint_angles` at every percent of the counted strides."""
        return self.normalise(self.reference_joint_angles, self.strides)

    @staticmethod
    def normalise(angles: Mapping[JointName, np.ndarray], bounds: np.ndarray) -> dict[JointName, np.ndarray]:
        """Return angles at every percent of strides."""
        return {joint: strides.normalise_strides(signal, bounds) for joint, signal in angles.items()}

    def all_values(self) -> StrideValues:
        """Return every quantity of the counted strides that the log and the experiment define."""
        found = {
            "start_s": self.strides[:, 0] * TICK,
            **self.timing(),
            **self.phase_onsets(),
            **self.ground(),
        }
        for joint, angle in self.reference_joint_angles.items():
            named = {**self.motion(angle), **self.errors(joint), **self.work(joint)}
            if joint in self.record.driven:
                named |= {**self.motor(joint), **self.power(joint), **self.switch_energy(joint)}
            if joint in self.record.angles:
                named |= self.jerk(joint)
            found |= {f"{joint}_{name}": values for name, values in named.items()}
        return found

    def timing(self) -> StrideValues:
        """Compute durations [s], cadence and, on the ground, shares of the stride and speed."""
        bounds, contacts = self.strides, self.record.contacts
        times = strides.stride_times(bounds, TICK)
        found = {"stride_time_s": times, "cadence_per_min": strides.cadences(times)}
        if contacts is None:
            return found
        swing, both = strides.swing_shares(bounds, contacts.toe_offs), self.double_support()
        return {
            **found,
            "stance_time_s": (1.0 - swing) * times,
            "swing_time_s": swing * times,
            "swing_share": swing,
            **({} if both is None else {"double_support_share": both}),
            "speed_m_per_s": ground_speeds(self.log, bounds, TICK),
        }

    def double_support(self) -> np.ndarray | None:
        """Compute the share of each stride with both feet loaded; None without a second foot."""
        loaded, other = self.record.loaded, self.other
        if loaded is None or other is None or other.loaded is None:
            return None
        return strides.double_support_shares(loaded, other.loaded, self.strides)

    def phase_onsets(self) -> StrideValues:
        """Compute the share of each stride at which each phase begins, in [%]."""
        return {
            f"{name}_onset_percent": phases.phase_onsets(
                self.record.phase_entries(index), self.strides, first=index == 0
            )
            for index, name in enumerate(self.table.phase_names)
        }

    def ground(self) -> StrideValues:
        """Compute steps, forces of the ground, slip and clearance; empty without weight on the ground."""
        walkway, force, other = self.run.walkway, self.record.normal_force, self.other
        if walkway is None or force is None or other is None:
            return {}
        fore_aft = np.asarray(self.log[f"{self.record.side}_foot_friction_force_N"])
        load, push = (
            strides.normalise_strides(values / walkway.carried_weight, self.strides)
            for values in (force, fore_aft)
        )
        names = ("loading_peak", "trough", "push_off_peak")
        peaks = [[load_measures(cycle)[name] for name in names] for cycle in load]
        pushes = [[*fore_aft_peaks(cycle).values()] for cycle in push]
        return {
            **ground_strides(self.log, self.record, other, walkway, self.strides),
            **dict(zip(names, np.array(peaks).reshape(-1, 3).T, strict=True)),
            **dict(zip(("braking_peak", "propulsion_peak"), np.array(pushes).reshape(-1, 2).T, strict=True)),
            "load_impulse_Ns": TICK * strides.stride_sums(force, self.strides),
        }

    def motion(self, angle: np.ndarray) -> StrideValues:
        """Compute range, lowest and highest angle in [deg]; ``angle``: angle of a joint in [rad]."""
        lowest, peak = np.degrees(strides.stride_extremes(angle, self.strides)).T
        return {"range_of_motion_deg": peak - lowest, "lowest_deg": lowest, "peak_deg": peak}

    def errors(self, joint: JointName) -> StrideValues:
        """Compute the parts of the distance of each stride from healthy walking; empty without one."""
        reference = reference_cycle(self.run.experiment, joint)
        if reference is None:
            return {}
        parts = [strides.error_parts(cycle[None], reference) for cycle in self.cycles[joint]]
        return {f"error_{name}": np.array([one[name] for one in parts]) for name in strides.ERROR_PARTS}

    def motor(self, joint: JointName) -> StrideValues:
        """Compute torque, current and tracking error of a driven joint."""
        torque, current = self.column(joint, "motor_torque_Nm"), self.column(joint, "measured_current_A")
        apart = self.column(joint, "measured_angle_rad") - self.column(joint, "equilibrium_rad")
        return {
            "torque_peak_Nm": strides.stride_extremes(np.abs(torque), self.strides)[:, 1],
            "torque_rms_Nm": np.sqrt(strides.stride_means(torque * torque, self.strides)),
            "current_rms_A": np.sqrt(strides.stride_means(current * current, self.strides)),
            "tracking_error_peak_deg": np.degrees(strides.stride_extremes(np.abs(apart), self.strides)[:, 1]),
        }

    def power(self, joint: JointName) -> StrideValues:
        """Compute the peak power [W] of a motor, and its work [J/kg of the wearer]; NaN without a wearer."""
        patient = self.run.experiment.patient
        power = self.column(joint, "motor_torque_Nm") * self.column(joint, "velocity_rad_per_s")
        return {
            "power_peak_W": strides.stride_extremes(power, self.strides)[:, 1],
            **self.specific_work(power, math.nan if patient is None else patient.mass),
        }

    def specific_work(self, power: np.ndarray, mass: float) -> StrideValues:
        """Integrate the positive and the negative part of a power [W], divided by a mass [kg], in [J/kg]."""
        return {
            f"{sign}_work_J_per_kg": TICK * strides.stride_sums(part, self.strides) / mass
            for sign, part in (("positive", np.maximum(power, 0.0)), ("negative", np.minimum(power, 0.0)))
        }

    def work(self, joint: JointName) -> StrideValues:
        """Compute the positive work [J] of the device on the wearer and of the wearer's muscles at a joint.

        Either is left out if the joint has no drive or the log no torque of muscles.
        """
        velocity, driven = self.wearer_joint_velocity(joint), joint in self.record.driven
        names = [f"{self.record.side}_{joint}_{source}_torque_Nm" for source in ("voluntary", OWN_GAIT)]
        torques = [np.asarray(self.log[name]) for name in names if name in self.log]
        sources = {"device_work_J": self.device_torque(joint)} if driven else {}
        if torques or driven:  # a log of a batch has no column for a torque that is zero
            sources["wearer_work_J"] = np.sum([np.zeros(len(velocity)), *torques], axis=0)
        return {
            name: TICK * strides.stride_sums(np.maximum(torque * velocity, 0.0),
                                             self.strides)
            for name, torque in sources.items()
        }  # fmt: skip

    def device_torque(self, joint: JointName) -> np.ndarray:
        """Return the torque of the device on the wearer at a driven joint in [N·m].

        With braces, it is the torque of the brace; otherwise the torque of the motor behind the gear.
        """
        brace = f"{self.record.side}_{joint}_brace_torque_Nm"
        if brace in self.log:
            return np.asarray(self.log[brace])
        columns = ("motor_torque_Nm", "friction_torque_Nm", "velocity_rad_per_s")
        inertia = self.run.experiment.plant.actuators[joint].armature
        motor, friction, velocity = (self.column(joint, name) for name in columns)
        return effort.interaction_torque(motor, friction, velocity, inertia, TICK)

    def switch_energy(self, joint: JointName) -> StrideValues:
        """Compute the net energy that switches add to the virtual spring of a joint in [J].

        The spring is that of the gait table, even if a limit or another controller keeps the motor from
        following it.
        """
        names = ("measured_angle_rad", "stiffness_Nm_per_rad", "equilibrium_rad")
        energy = switching.switching_energy(*(self.column(joint, name) for name in names))
        return {"switch_energy_J": strides.stride_sums(energy, self.strides)}

    def jerk(self, joint: JointName) -> StrideValues:
        """Compute the dimensionless jerk of a joint with :mod:`twin_gait.measures.switching`."""
        velocity = self.wearer_joint_velocity(joint)
        jerk = switching.joint_jerk(velocity, TICK)
        return {"jerk_dimensionless": switching.dimensionless_jerk(velocity, jerk, self.strides, TICK)}
