"""Scaling of a gait table to wearer, support and belt speed, by the laws that the table defines."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from twin_gait.core.impedance import damping_from_ratio
from twin_gait.gait.guards import Comparison, Guard, PhaseMembership, map_atoms
from twin_gait.gait.signals import ANGLE, signal_scale
from twin_gait.gait.table import GaitTable, PhaseParameters
from twin_gait.vocabulary import JointName, Side

InertiaAt = Callable[[Side, Mapping[str, float], str], float]


def scale_table(
    table: GaitTable, *, carried_mass: float | None, speed: float | None, height: float | None = None
) -> GaitTable:
    r"""Apply the scaling laws of a table.

    With carried mass m, wearer's height h, belt speed v, the references of
    :class:`~twin_gait.gait.table.Scaling` with index 0 and its exponents:

    .. math::

        k_{stance} \to k \left(\frac{m}{m_0}\right)^{\alpha}, \qquad
        \theta_{hip} \to \theta_c + (\theta_{hip} - \theta_c)
        \left(\frac{v}{v_0}\right)^{\beta}\left(\frac{h}{h_0}\right)^{\gamma}

    for the stiffness of the stance phases, hip equilibria and hip thresholds.

    ``carried_mass``: mass of wearer and device times (1 - support) in [kg]; None switches its law off.
    ``speed``: belt speed in [m/s]; None switches its law off. ``height``: height of the wearer in [m], as
    set in the controller; None switches its law off. Returns the adapted table; values whose law is off are
    unchanged.
    """
    law = table.scaling
    stiffness = _power(carried_mass, law.carried_mass, law.carried_mass_exponent)
    excursion = _power(speed, law.speed, law.speed_exponent) * _power(height, law.height, law.height_exponent)
    centre, stiff = law.hip_centre, dict.fromkeys(law.stance_phases, stiffness)

    def adapt(phases: Mapping[str, PhaseParameters]) -> dict[str, PhaseParameters]:
        return {
            name: _scale_phase(phase, stiff.get(name, 1.0), excursion, centre)
            for name, phase in phases.items()
        }

    sides = {side: adapt(phases) for side, phases in table.side_phases.items()}
    transitions = tuple(
        replace(item, guard=_scale_guard(item.guard, excursion, centre))
        if any(map(_is_hip_threshold, item.atoms))
        else item
        for item in table.transitions
    )
    return replace(table, phases=adapt(table.phases), side_phases=sides, transitions=transitions)


def _power(value: float | None, reference: float | None, exponent: float) -> float:
    """Compute the ratio of value and reference to the power of the exponent; 1 if the law is off."""
    return 1.0 if value is None or reference is None else (value / reference) ** exponent


def _scale_phase(
    phase: PhaseParameters, stiffness: float, excursion: float, centre: float
) -> PhaseParameters:
    joints = {}
    for name, joint in phase.joints.items():
        equilibrium = joint.equilibrium_angle
        if name == JointName.HIP:
            equilibrium = equilibrium + (excursion - 1.0) * (equilibrium - centre)
        changes = stiffness != 1.0 or equilibrium != joint.equilibrium_angle
        joints[name] = (
            replace(joint, stiffness=stiffness * joint.stiffness, equilibrium_angle=equilibrium)
            if changes
            else joint
        )
    return replace(phase, joints=joints)


def _scale_guard(guard: Guard, excursion: float, centre: float) -> Guard:
    def scaled(atom: Comparison | PhaseMembership) -> Guard:
        if not (isinstance(atom, Comparison) and _is_hip_threshold(atom)):
            return atom
        about = centre / signal_scale(atom.signal) if atom.minus is None else 0.0
        return replace(atom, threshold=atom.threshold + (excursion - 1.0) * (atom.threshold - about))

    return map_atoms(guard, scaled)


def _is_hip_threshold(atom: Comparison | PhaseMembership) -> bool:
    """Check whether a condition compares hip angles, whose thresholds are scaled."""
    return isinstance(atom, Comparison) and _is_hip_angle(atom.signal) and _is_hip_angle(atom.minus)


def _is_hip_angle(signal: str | None) -> bool:
    """Check whether a signal is a hip angle of either leg; None, an absent second signal, counts as one."""
    return signal is None or signal.endswith(ANGLE.joint_signal_name(JointName.HIP))


def resolve_phases(table: GaitTable, side: Side, inertia_at: InertiaAt) -> np.ndarray:
    """Lay out the phases of one side as numbers, with damping ratios resolved.

    ``inertia_at``: function that returns the effective inertia in [kg·m²] of a joint of a side at the
    equilibrium angles of all joints of a phase, armature included: M_jj with the pelvis fixed. Returns shape
    ``(n_phases, 4 n_joints + 1)``: k, b, θ0, G of each joint, then the gravity share.
    """
    rows = []
    for phase in table.phases_of(side).values():
        posture = {name: phase.joints[name].equilibrium_angle for name in table.joints}
        row: list[float] = []
        for name in table.joints:
            joint = phase.joints[name]
            damping = joint.damping
            if damping is None:
                assert joint.damping_ratio is not None  # JointImpedance has exactly one of them.
                inertia = inertia_at(side, posture, name)
                damping = damping_from_ratio(joint.damping_ratio, joint.stiffness, inertia)
            row += [joint.stiffness, damping, joint.equilibrium_angle, joint.friction_compensation_gain]
        rows.append([*row, phase.gravity_compensation])
    return np.array(rows)
