"""Body segments of the wearer and the sizes of the device, against tables typed from their sources."""

from __future__ import annotations

import json

import numpy as np
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from twin_device import TWIN_SIZES

from twin_gait import load_experiment
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.leg_model.anthropometry import (
    SEGMENTS,
    Segment,
    device_sizes,
    foot_line,
    segment_inertia,
    trunk_mass,
    wearer_notes,
    wearer_segments,
)
from twin_gait.parameters.wearer import Patient
from twin_gait.vocabulary import SegmentModel, Sex

# Sizes of TWIN: three waists, six femurs, a tibia that is adjusted (thesis, table 2.1; the numbers are ours).
FEMURS, WAISTS = (0.36, 0.38, 0.40, 0.42, 0.44, 0.46), (0.34, 0.38, 0.42)

# de Leva (1996), J Biomech 29(9):1223-1230, table 4, as transcribed in the data folder of the BMC
# notebooks (BMClab): mass in % of the body, centre of mass and radii of gyration (transverse,
# longitudinal) in % of the segment. Endpoints: hip-knee, knee-ankle, heel-toe.
DE_LEVA = {
    (Sex.MALE, "thigh"): (14.16, 40.95, 32.9, 14.9),
    (Sex.MALE, "shank"): (4.33, 43.95, 24.6, 10.2),
    (Sex.MALE, "foot"): (1.37, 44.15, 24.5, 12.4),
    (Sex.FEMALE, "thigh"): (14.78, 36.12, 36.4, 16.2),
    (Sex.FEMALE, "shank"): (4.81, 43.52, 26.3, 9.2),
    (Sex.FEMALE, "foot"): (1.29, 40.14, 27.9, 13.9),
}

# Head and trunk, upper arm, forearm, hand of the same table: what is not leg.
DE_LEVA_REST = {Sex.MALE: (6.94, 43.46, 2.71, 1.62, 0.61), Sex.FEMALE: (6.68, 42.57, 2.55, 1.38, 0.56)}

# Winter (2009), table 4.1, as transcribed in the same folder: mass, centre of mass from the proximal end,
# radii of gyration about the centre of mass, the proximal and the distal end.
WINTER = {
    "thigh": (0.100, 0.433, 0.323, 0.540, 0.653),
    "shank": (0.0465, 0.433, 0.302, 0.528, 0.643),
    "foot": (0.0145, 0.500, 0.475, 0.690, 0.690),
}
WINTER_TOTAL_LEG, WINTER_FOOT_AND_SHANK, WINTER_HEAD_ARMS_TRUNK = 0.161, 0.061, 0.678

heights = st.floats(1.47, 1.95)  # what the tibia covers
sexes = st.sampled_from(list(Sex))


@pytest.mark.parametrize(("sex", "name"), list(DE_LEVA), ids=str)
def test_segments_equal_de_leva(sex: Sex, name: str) -> None:
    segment = SEGMENTS[sex][name]
    shares = (
        segment.mass,
        segment.centre_of_mass,
        segment.transverse_radius,
        segment.longitudinal_radius,
    )
    assert_allclose(shares, np.array(DE_LEVA[sex, name]) / 100.0, rtol=1e-12)


@pytest.mark.parametrize("sex", list(Sex))
def test_trunk_mass_equals_head_arms_and_trunk_of_the_table(sex: Sex) -> None:
    head, trunk, upper_arm, forearm, hand = DE_LEVA_REST[sex]
    expected = (head + trunk + 2.0 * (upper_arm + forearm + hand)) / 100.0
    # The table sums to 100 % within the rounding of its entries.
    assert_allclose(trunk_mass(Patient(mass=80.0, sex=sex)) / 80.0, expected, atol=6e-4)


@given(mass=st.floats(30.0, 110.0), sex=sexes)
def test_segments_and_trunk_add_up_to_the_body(mass: float, sex: Sex) -> None:
    patient = Patient(mass=mass, sex=sex)
    axis = np.array([0.0, 0.0, -0.4])
    legs = 2.0 * sum(segment_inertia(item, mass, axis)[0] for item in SEGMENTS[sex].values())
    assert_allclose(legs + trunk_mass(patient), mass, rtol=1e-12)


def of_winter(mass: float = 70.0, height: float = 1.75, sex: Sex = Sex.MALE) -> Patient:
    return Patient(mass=mass, height=height, sex=sex, segment_model=SegmentModel.WINTER)


def test_segments_are_from_de_leva_by_default_and_from_winter_on_request() -> None:
    for sex in Sex:
        assert wearer_segments(Patient(sex=sex)) == SEGMENTS[sex]
        assert {name: item.mass for name, item in wearer_segments(of_winter(sex=sex)).items()} == {
            name: row[0] for name, row in WINTER.items()
        }


def test_masses_of_winter_equal_legs_and_trunk_of_his_table() -> None:
    segments = wearer_segments(of_winter())
    assert_allclose(sum(item.mass for item in segments.values()), WINTER_TOTAL_LEG, rtol=1e-12)
    assert_allclose(segments["shank"].mass + segments["foot"].mass, WINTER_FOOT_AND_SHANK, rtol=1e-12)
    assert_allclose(trunk_mass(of_winter(80.0)), 80.0 * WINTER_HEAD_ARMS_TRUNK, rtol=1e-12)


@pytest.mark.parametrize("name", list(WINTER))
def test_inertia_about_either_end_equals_winter(name: str) -> None:
    """The table gives radii of gyration about both ends; ours come from the one about the centre."""
    _, share, _, proximal, distal = WINTER[name]
    segment = wearer_segments(of_winter())[name]
    assert_allclose(segment.centre_of_mass, share, rtol=1e-12)
    for from_end, radius in ((share, proximal), (1.0 - share, distal)):
        # Three digits are printed of each of the radii.
        assert_allclose(np.hypot(segment.transverse_radius, from_end), radius, atol=1.1e-3)


def test_thigh_and_shank_of_winter_equal_gait2d() -> None:
    """Constants of gait2d (van den Bogert; 75 kg, 1.80 m): mass, inertia and distance of the centre."""
    for name, length, expected in (
        ("thigh", 0.4410, (7.5, 0.1522, 0.1910)),
        ("shank", 0.4428, (3.4875, 0.0624, 0.1917)),
    ):
        axis = np.array([0.0, 0.0, -length])
        mass, centre, inertia = segment_inertia(wearer_segments(of_winter())[name], 75.0, axis)
        assert_allclose((mass, inertia[1, 1], -centre[2]), expected, atol=6e-5)


def test_foot_of_winter_hangs_between_ankle_and_second_metatarsal() -> None:
    """0.152 · 1.75 = 0.266 m: from the ankle (0.72 − 0.25) · 0.266 = 0.12502 m forward, 0.034125 m down."""
    start, axis = foot_line(of_winter())
    assert_allclose(start, [0.0, 0.0], atol=0.0)
    assert_allclose(axis, [0.12502, -0.034125], rtol=1e-12)
    heel, foot = foot_line(Patient(height=1.75))
    assert_allclose(heel, [-0.0665, -0.034125], rtol=1e-12)
    assert_allclose(foot, [0.266, 0.0], atol=1e-15)


def test_male_thigh_of_a_70_kg_wearer_by_hand() -> None:
    """0.1416 · 70 = 9.912 kg at 0.4095 · 0.42 m; m (0.329 · 0.42)² = 0.18926 and m (0.149 · 0.42)² kg·m²."""
    mass, centre, inertia = segment_inertia(SEGMENTS[Sex.MALE]["thigh"], 70.0, np.array([0.0, 0.0, -0.42]))
    assert_allclose(mass, 9.912, rtol=1e-12)
    assert_allclose(centre, [0.0, 0.0, -0.17199], rtol=1e-12)
    assert_allclose(np.diag(inertia), [0.189257, 0.189257, 0.038818], atol=5e-7)
    assert_allclose(inertia, np.diag(np.diag(inertia)), atol=1e-15)


axes = st.tuples(*[st.floats(-0.5, 0.5)] * 3).map(np.array).filter(lambda axis: np.linalg.norm(axis) > 0.05)


@given(axis=axes)
def test_inertia_does_not_depend_on_the_direction_of_the_segment(axis: np.ndarray) -> None:
    """Principal inertias: twice the transverse one and the longitudinal one along the axis."""
    segment = Segment(mass=0.1, centre_of_mass=0.4, transverse_radius=0.3, longitudinal_radius=0.1)
    mass, centre, inertia = segment_inertia(segment, 70.0, axis)
    length = float(np.linalg.norm(axis))
    expected = mass * length**2 * np.array([0.1**2, 0.3**2, 0.3**2])
    assert_allclose(np.linalg.eigvalsh(inertia), expected, rtol=1e-9)
    assert_allclose(inertia @ axis, mass * (0.1 * length) ** 2 * axis, atol=1e-12)
    assert_allclose(centre, 0.4 * axis, rtol=1e-14)


@given(height=heights)
def test_device_is_set_to_the_nearest_sizes(height: float) -> None:
    """Thigh 0.245 H, shank 0.246 H, hips 0.191 H (Drillis and Contini, in Winter, 2009)."""
    sizes = device_sizes(Patient(height=height), TWIN_SIZES)
    assert sizes.femur in FEMURS
    assert all(abs(sizes.femur - 0.245 * height) <= abs(size - 0.245 * height) for size in FEMURS)
    assert_allclose(sizes.tibia, 0.246 * height, rtol=1e-12)
    assert sizes.waist in WAISTS


@given(height=st.floats(1.50, 1.88))
def test_femur_of_a_5th_to_95th_percentile_wearer_misfits_by_a_centimetre_at_most(height: float) -> None:
    sizes = device_sizes(Patient(height=height), TWIN_SIZES)
    assert abs(sizes.femur - 0.245 * height) <= 0.0100001


def test_wider_hips_get_a_wider_waist() -> None:
    waists = [device_sizes(Patient(height=height), TWIN_SIZES).waist for height in (1.50, 1.75, 1.93)]
    assert waists == sorted(waists)
    assert len(set(waists)) > 1


@pytest.mark.parametrize("height", [1.40, 1.46, 1.96, 2.05])
def test_wearer_outside_the_range_of_the_tibia_is_refused(height: float) -> None:
    with raises(ParameterError, f"got {height!r}", "0.36", "leg.sizes: null"):
        device_sizes(Patient(height=height), TWIN_SIZES)


@given(height=st.floats(0.70, 2.20))
def test_device_made_to_measure_has_the_lengths_of_the_wearer(height: float) -> None:
    sizes = device_sizes(Patient(height=height))
    lengths = [sizes.femur, sizes.tibia, sizes.waist, sizes.foot]
    assert_allclose(lengths, height * np.array([0.245, 0.246, 0.191, 0.152]), rtol=1e-12)


@pytest.mark.parametrize(
    ("sizes", "facts"),
    [
        ({"femur_m": []}, ("femur", "at least one")),
        ({"femur_m": ["long"]}, ("femur_m[0]", "long")),
        ({"waist_m": [0.38, -0.1]}, ("waist_m[1]", "-0.1")),
        ({"tibia_m": [0.48, 0.36]}, ("tibia", "shortest")),
        ({"tibia_m": [0.36]}, ("tibia_m",)),
    ],
)
def test_wrong_size_is_refused_with_its_key(sizes: dict[str, object], facts: tuple[str, ...]) -> None:
    with raises(ParameterFileError, *facts):
        load_experiment(
            "treadmill_guided", [f"leg.sizes.{key}={json.dumps(value)}" for key, value in sizes.items()]
        )


def test_wearer_outside_the_sizes_walks_with_a_device_made_to_measure() -> None:
    experiment = load_experiment("treadmill_guided", ["leg.sizes=null", "patient.height_m=2.05"]).experiment
    sizes = experiment.build_world().model.sizes
    assert sizes is not None
    assert sizes.femur == pytest.approx(0.245 * 2.05)


@pytest.mark.parametrize(
    ("patient", "words"),
    [
        (Patient(mass=120.0), ["mass 120 kg", "55 to 91 kg"]),
        (Patient(mass=20.0, height=1.1), ["mass 20 kg", "height 1.1 m", "1.62 to"]),
        (Patient(mass=85.0, sex=Sex.FEMALE), ["young women", "mass 85 kg", "47 to 76 kg"]),
        (Patient(mass=85.0, segment_model=SegmentModel.WINTER), ["Dempster", "mass 85 kg"]),
    ],
)
def test_wearer_unlike_the_subjects_of_the_table_is_extrapolated(patient: Patient, words: list[str]) -> None:
    (note,) = wearer_notes(patient)
    assert all(word in note for word in words)


def test_wearer_like_the_subjects_has_no_note_and_a_heavy_one_exceeds_the_device() -> None:
    assert wearer_notes(Patient()) == []
    assert "110 kg of the device" in wearer_notes(Patient(mass=111.0), heaviest=110.0)[-1]
    assert len(wearer_notes(Patient(mass=110.0), heaviest=110.0)) == 1


@pytest.mark.parametrize(("mass", "height"), [(10.0, 0.75), (160.0, 2.05)])
def test_segments_of_the_smallest_and_the_largest_wearer_have_their_mass(mass: float, height: float) -> None:
    """The legs of the wearer have the lengths of the links of the URDF, and the mass of the table."""
    experiment = load_experiment(
        "treadmill_guided", ["leg.fit_device=false", f"patient={{mass_kg: {mass}, height_m: {height}}}"]
    ).experiment
    model = experiment.build_world().model
    empty = load_experiment("treadmill_guided", ["leg.fit_device=false", "patient=null"]).experiment
    device = empty.leg_model(None, experiment.scenario.pelvis).total_mass
    assert model.total_mass - device == pytest.approx(mass)
    inertia = np.linalg.eigvalsh(model.mass_matrix(np.zeros(model.nv)))
    assert inertia.min() > 0.0
