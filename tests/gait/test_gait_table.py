"""The rules of a gait table as frozen data, and its scaling laws."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from errors import states
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from table_builder import JOINTS, guard, impedance, phase, transition, two_phase_table

from twin_gait.configuration.documents import table_document
from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.core import blending
from twin_gait.core.control_tick import COLUMNS_PER_JOINT
from twin_gait.exceptions import GaitTableError, ParameterError, TwinGaitError
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, PhaseMembership
from twin_gait.gait.program import compile_guards
from twin_gait.gait.scaling import resolve_phases, scale_table
from twin_gait.gait.table import Blending, BlendingLaw, GaitTable, Scaling
from twin_gait.vocabulary import FIRST_SWING, STAND, GaitPhase, Side


def message_of(build: Callable[[], object], kind: type[Exception] = GaitTableError) -> str:
    """One-line message of the error that a table raises."""
    with pytest.raises(kind) as caught:
        build()
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


def test_sound_table_is_accepted() -> None:
    table = two_phase_table()
    assert table.phase_names == ("stance", "swing")
    assert table.phase_index("swing") == 1


def test_table_needs_joints_and_phases() -> None:
    assert "joints" in message_of(lambda: two_phase_table(joints=()))
    assert "phases" in message_of(lambda: GaitTable(name="empty", joints=JOINTS, phases={}, transitions=()))


def test_joint_named_twice_is_refused() -> None:
    """Signals and parameter columns of equal names would be ambiguous."""
    assert "hip" in message_of(lambda: two_phase_table(joints=("hip", "hip", "knee")), TwinGaitError)


def test_every_joint_needs_an_impedance_in_every_phase() -> None:
    lacking = {"stance": phase(), "swing": phase(joints={"hip": impedance()})}
    message = message_of(lambda: two_phase_table(phases=lacking))
    assert "phases.swing" in message
    assert "knee" in message


def test_impedance_of_an_unknown_joint_is_refused() -> None:
    extra = {name: impedance() for name in (*JOINTS, "ankle")}
    message = message_of(lambda: two_phase_table(phases={"stance": phase(joints=extra), "swing": phase()}))
    assert "ankle" in message
    assert "hip, knee" in message


@pytest.mark.parametrize("side_phases", [{"flight": phase()}, {"swing": phase(joints={"hip": impedance()})}])
def test_differences_of_a_side_follow_the_same_rules(side_phases: dict[str, Any]) -> None:
    message_of(lambda: two_phase_table(side_phases={Side.LEFT: side_phases}))


@pytest.mark.parametrize(
    ("source", "target", "facts"),
    [
        ("stance", "flight", ("flight", "stance", "swing")),
        ("flight", "swing", ("flight", "stance", "swing")),
        ("stance", "stance", ("itself",)),
    ],
)
def test_transition_must_lead_between_two_known_phases(
    source: str, target: str, facts: tuple[str, ...]
) -> None:
    entry = transition(source, target, "hip.angle_deg > 10", cause="lift_off")
    message = message_of(lambda: two_phase_table(transition("stance", "swing", "hip.angle_deg > 1"), entry))
    assert states(message, "transitions[1] (lift_off)", *facts)


@pytest.mark.parametrize("nest", [lambda inner: inner, lambda inner: AnyOf(guards=(AllOf(guards=(inner,)),))])
def test_guard_that_names_an_unknown_phase_is_refused(nest: Callable[[Any], Any]) -> None:
    membership = nest(PhaseMembership(phases=("stance", "flight")))
    assert "'flight'" in message_of(lambda: two_phase_table(transition("stance", "swing", membership)))


def test_single_phase_needs_no_exit() -> None:
    """A controller with one set of parameters is a table too."""
    table = GaitTable(name="one", joints=JOINTS, phases={"hold": phase()}, transitions=())
    assert compile_guards(table).transitions == []


def test_timeout_must_not_come_before_the_minimum_duration() -> None:
    phases = {"stance": phase(minimum_ticks=200), "swing": phase()}
    entry = transition("stance", "swing", timeout_ticks=199)
    message = message_of(lambda: two_phase_table(entry, phases=phases))
    assert "0.199" in message
    assert "200" in message
    assert two_phase_table(transition("stance", "swing", timeout_ticks=200), phases=phases).transitions


def test_transition_without_any_condition_is_refused() -> None:
    assert "no condition" in message_of(lambda: transition("stance", "swing"))


def test_timeout_is_a_transition_without_a_guard() -> None:
    assert transition("stance", "swing", timeout_ticks=10).is_timeout
    assert not transition("stance", "swing", "hip.angle_deg > 1", timeout_ticks=10).is_timeout
    assert not transition("stance", "swing", "hip.angle_deg > 1").is_timeout


@pytest.mark.parametrize(
    "build",
    [
        lambda: transition("stance", "swing", "hip.angle_deg > 1", debounce_ticks=0),
        lambda: transition("stance", "swing", timeout_ticks=0),
        lambda: phase(minimum_ticks=-1),
        lambda: phase(gravity_compensation=1.01),
        lambda: phase(gravity_compensation=-0.01),
        lambda: phase(gravity_compensation=math.nan),
        lambda: impedance(stiffness=-1.0),
        lambda: impedance(stiffness=math.inf),
        lambda: impedance(damping=-1.0),
        lambda: impedance(damping=None),
        lambda: impedance(damping_ratio=0.7),
        lambda: impedance(damping=None, damping_ratio=-0.1),
        lambda: impedance(damping=None, damping_ratio=math.nan),
        lambda: impedance(equilibrium_angle=math.nan),
        lambda: impedance(friction_compensation_gain=1.1),
        lambda: impedance(friction_compensation_gain=-0.1),
        lambda: Blending(duration_ticks=-1),
        lambda: Scaling(carried_mass=0.0),
        lambda: Scaling(speed=-0.4),
        lambda: Scaling(speed_exponent=math.inf),
        lambda: Scaling(hip_centre=math.nan),
    ],
)
def test_values_out_of_range_are_refused(build: Callable[[], object]) -> None:
    assert "expected" in message_of(build, ParameterError)


def test_scaling_names_known_phases() -> None:
    message = message_of(lambda: two_phase_table(scaling=Scaling(stance_phases=("flight",))))
    assert "scaling.stance_phases" in message


def test_an_unknown_phase_lists_the_known_phases() -> None:
    assert "stance, swing" in message_of(lambda: two_phase_table().phase_index("flight"))


def test_table_is_frozen() -> None:
    table = two_phase_table()
    with pytest.raises(dataclasses.FrozenInstanceError):
        table.name = "other"  # type: ignore[misc]


def test_differences_of_one_side_leave_the_other_alone() -> None:
    weak = phase(joints={name: impedance(stiffness=50.0) for name in JOINTS})
    table = two_phase_table(side_phases={Side.LEFT: {"swing": weak}})
    assert table.phases_of(Side.LEFT)["swing"].joints["hip"].stiffness == 50.0
    assert table.phases_of(Side.LEFT)["stance"] == table.phases["stance"]
    assert table.phases_of(Side.RIGHT) == table.phases


@pytest.mark.parametrize(
    "entry",
    [
        {"timeout_ticks": 10**30},
        {"condition": "hip.angle_deg > 1", "debounce_ticks": 10**30},
    ],
    ids=["timeout", "debounce"],
)
def test_a_time_beyond_64_bits_is_refused_with_a_reason(entry: dict[str, Any]) -> None:
    with pytest.raises(TwinGaitError):
        compile_guards(two_phase_table(transition("stance", "swing", **entry)))


def test_a_minimum_duration_beyond_64_bits_is_refused_with_a_reason() -> None:
    with pytest.raises(TwinGaitError):
        compile_guards(two_phase_table(phases={"stance": phase(minimum_ticks=10**30), "swing": phase()}))


def test_blending_laws_have_the_codes_of_the_core() -> None:
    assert all(law.code == getattr(blending, f"BLEND_{law.name}") for law in BlendingLaw)


def test_foot_is_in_the_air_in_swing_phases_except_pre_swing() -> None:
    names = (*GaitPhase, STAND, FIRST_SWING, "pre_swing", "Terminal_Swing", "swinging_in")
    table = two_phase_table(
        phases={name: phase() for name in ("stance", "swing", *names)},
        transitions=tuple(
            transition(source, target, "hip.angle_deg > 0")
            for source, target in zip(("stance", "swing", *names), ("swing", *names, "stance"), strict=True)
        ),
        scaling=Scaling(stance_phases=("swinging_in",)),
    )
    swings = [name for name in names if table.is_swing(name)]
    assert swings == ["swing_flexion", "swing_extension", FIRST_SWING, "Terminal_Swing"]


# ---------------------------------------------------------------------------------- scaling


def scaled(table: GaitTable, mass: float | None = None, speed: float | None = None) -> GaitTable:
    return scale_table(table, carried_mass=mass, speed=speed)


def scaling_table(law: Scaling) -> GaitTable:
    joints = {"hip": impedance(equilibrium_angle=0.5), "knee": impedance(equilibrium_angle=0.7)}
    return two_phase_table(
        transition(
            "stance", "swing", AllOf(guards=(guard("hip.angle_deg < -10"), guard("knee.angle_deg > 30")))
        ),
        transition("stance", "swing", "other.hip.angle_deg - hip.angle_deg > 20", cause="apart"),
        transition("stance", "swing", "hip.velocity_deg_per_s < 50", cause="slow"),
        phases={"stance": phase(joints=joints), "swing": phase(joints=joints)},
        side_phases={Side.RIGHT: {"stance": phase(joints=joints)}},
        scaling=law,
    )


@given(
    mass=st.floats(5.0, 200.0),
    speed=st.floats(0.1, 2.0),
    exponent=st.floats(-1.0, 1.0),
    centre=st.floats(-0.5, 0.5),
)
def test_at_its_references_a_table_is_unchanged(
    mass: float, speed: float, exponent: float, centre: float
) -> None:
    law = Scaling(
        carried_mass=mass,
        stance_phases=("stance",),
        speed=speed,
        speed_exponent=exponent,
        hip_centre=centre,
    )
    table = scaling_table(law)
    assert scaled(table, mass, speed) == table


@given(mass=st.floats(5.0, 200.0), speed=st.floats(0.1, 2.0), centre=st.floats(-0.5, 0.5))
def test_without_references_no_law_acts(mass: float, speed: float, centre: float) -> None:
    table = scaling_table(Scaling(hip_centre=centre, speed_exponent=0.5, stance_phases=("stance",)))
    assert scaled(table, mass, speed) == table


def test_load_scales_the_stiffness_of_stance_only() -> None:
    table = scaling_table(Scaling(carried_mass=40.0, stance_phases=("stance",)))
    heavier = scaled(table, mass=60.0)
    for joint in JOINTS:
        assert_allclose(heavier.phases["stance"].joints[joint].stiffness, 150.0, rtol=1e-12)
        assert_allclose(heavier.phases_of(Side.RIGHT)["stance"].joints[joint].stiffness, 150.0, rtol=1e-12)
        assert heavier.phases["swing"].joints[joint] == table.phases["swing"].joints[joint]
    assert heavier.transitions == table.transitions


def test_speed_draws_hip_angles_towards_the_centre_and_leaves_the_knee() -> None:
    """A quarter of the speed with exponent 1/2 halves the excursion about 0.1 rad (5.7296°)."""
    table = scaling_table(Scaling(speed=0.4, speed_exponent=0.5, hip_centre=0.1))
    slower = scaled(table, speed=0.1)
    for name in ("stance", "swing"):
        assert_allclose(slower.phases[name].joints["hip"].equilibrium_angle, 0.3, rtol=1e-12)
        assert slower.phases[name].joints["knee"] == table.phases[name].joints["knee"]
        assert slower.phases[name].joints["hip"].stiffness == table.phases[name].joints["hip"].stiffness
    both, apart, fast = (item.guard for item in slower.transitions[:3])
    assert isinstance(both, AllOf)
    hip, knee = both.guards
    assert isinstance(hip, Comparison)
    assert_allclose(hip.threshold, 0.5 * (-10.0 + math.degrees(0.1)), rtol=1e-12)
    assert knee == guard("knee.angle_deg > 30")
    assert isinstance(apart, Comparison)
    assert_allclose(apart.threshold, 10.0, rtol=1e-12)  # a distance between the legs has no centre
    assert fast == guard("hip.velocity_deg_per_s < 50")


def test_scaling_exponents_act_as_powers() -> None:
    """Twice the load with exponent 1/2, and twice the height with -1: half the hip's excursion."""
    law = Scaling(
        carried_mass=40.0,
        carried_mass_exponent=0.5,
        stance_phases=("stance",),
        height=1.5,
        height_exponent=-1.0,
    )
    table = scaling_table(law)
    grown = scale_table(table, carried_mass=80.0, speed=None, height=3.0)
    for joint in JOINTS:
        assert_allclose(grown.phases["stance"].joints[joint].stiffness, 100.0 * math.sqrt(2.0), rtol=1e-12)
        assert grown.phases["swing"].joints[joint].stiffness == 100.0
    assert_allclose(grown.phases["swing"].joints["hip"].equilibrium_angle, 0.25, rtol=1e-12)
    assert grown.phases["swing"].joints["knee"].equilibrium_angle == 0.7
    apart = grown.transitions[1].guard
    assert isinstance(apart, Comparison)
    assert_allclose(apart.threshold, 10.0, rtol=1e-12)


def test_a_table_without_a_reference_wearer_is_not_scaled_to_a_wearer() -> None:
    table = scaling_table(Scaling(height=1.75, height_exponent=1.0))
    assert scale_table(table, carried_mass=None, speed=None) == table


def test_every_scaling_law_survives_its_file() -> None:
    law = Scaling(
        carried_mass=40.0,
        carried_mass_exponent=0.8,
        stance_phases=("stance",),
        speed=0.4,
        speed_exponent=0.1,
        height=1.75,
        height_exponent=-0.2,
        hip_centre=0.2,
    )
    table = scaling_table(law)
    assert gait_table_from_mapping(table_document(table), "the test", "two").scaling == law


def test_damping_ratio_is_resolved_with_the_inertia_at_the_equilibrium() -> None:
    joints = {
        "hip": impedance(damping=None, damping_ratio=0.7, stiffness=150.0, equilibrium_angle=0.3),
        "knee": impedance(damping=12.0, equilibrium_angle=0.6),
    }
    table = two_phase_table(
        phases={"stance": phase(joints=joints, gravity_compensation=0.25), "swing": phase()}
    )
    calls = []

    def inertia(side: Side, posture: Any, joint: str) -> float:
        calls.append((side, dict(posture), joint))
        return 6.0

    rows = resolve_phases(table, Side.LEFT, inertia)
    assert rows.shape == (2, 2 * COLUMNS_PER_JOINT + 1)
    assert_allclose(rows[0, :4], [150.0, 2.0 * 0.7 * math.sqrt(150.0 * 6.0), 0.3, 0.35], rtol=1e-12)
    assert_allclose(rows[0, 4:], [100.0, 12.0, 0.6, 0.35, 0.25], rtol=1e-12)
    assert calls == [(Side.LEFT, {"hip": 0.3, "knee": 0.6}, "hip")]
    assert np.isfinite(rows).all()
