"""Sign conventions, both ways, against what other projects publish."""

from __future__ import annotations

import numpy as np
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st

from twin_gait.conventions import (
    CONVENTIONS,
    CORC_X2,
    OPENSIM_GAIT2392,
    OSL,
    RAJAGOPAL,
    Convention,
    find_convention,
)
from twin_gait.exceptions import ParameterError
from twin_gait.vocabulary import JointName, Side

HIP, KNEE, ANKLE = JointName.HIP, JointName.KNEE, JointName.ANKLE


def package_degrees(convention: Convention, joint: JointName, degrees: float) -> float:
    return float(np.degrees(convention.convert_angle(joint, np.radians(degrees))))


@pytest.mark.parametrize("convention", CONVENTIONS.values(), ids=str)
@given(angle=st.floats(-3.0, 3.0))
def test_there_and_back_is_the_same_angle(convention, angle):
    for joint in JointName:
        assert convention.convert_angle(joint, convention.convert_angle(joint, np.array(angle))) == angle


def test_gait2392_counts_knee_flexion_negative():
    # opensim-models, Gait2392_Simbody/Tutorial1/normal.mot, 0.22 s: the left leg in mid-swing, where a
    # healthy knee is flexed by some 60 degrees, the hip swings forward and the foot still points down.
    hip_flexion_l, knee_angle_l, ankle_angle_l = 11.96, -58.25, -5.28
    assert package_degrees(OPENSIM_GAIT2392, HIP, hip_flexion_l) == pytest.approx(11.96)
    assert package_degrees(OPENSIM_GAIT2392, KNEE, knee_angle_l) == pytest.approx(58.25)
    assert package_degrees(OPENSIM_GAIT2392, ANKLE, ankle_angle_l) == pytest.approx(-5.28)
    back = OPENSIM_GAIT2392.convert_angle(KNEE, np.radians(58.25))
    assert np.degrees(back) == pytest.approx(knee_angle_l)


def test_rajagopal_counts_knee_flexion_positive():
    # opensim-models, Pipelines/Rajagopal/outputReference/ResultsIK/subject01_run_IK.mot, 0.23 s: the left
    # leg in the swing of a run, its knee flexed by more than a right angle.
    hip_flexion_l, knee_angle_l = 14.73839068, 92.35758777
    assert package_degrees(RAJAGOPAL, HIP, hip_flexion_l) == pytest.approx(hip_flexion_l)
    assert package_degrees(RAJAGOPAL, KNEE, knee_angle_l) == pytest.approx(knee_angle_l)
    assert np.degrees(RAJAGOPAL.convert_angle(KNEE, np.radians(60.0))) == pytest.approx(60.0)


def test_the_two_models_of_opensim_differ_in_the_knee_only():
    assert OPENSIM_GAIT2392.columns == RAJAGOPAL.columns
    angle = np.array(0.7)
    for joint in (HIP, ANKLE):
        assert OPENSIM_GAIT2392.convert_angle(joint, angle) == RAJAGOPAL.convert_angle(joint, angle)
    assert OPENSIM_GAIT2392.convert_angle(KNEE, angle) == -RAJAGOPAL.convert_angle(KNEE, angle)
    assert RAJAGOPAL.columns[Side.LEFT, KNEE] == "knee_angle_l"
    assert RAJAGOPAL.columns[Side.RIGHT, HIP] == "hip_flexion_r"


def test_the_x2_bends_its_knee_from_0_to_minus_120_and_its_hip_from_minus_40_to_120():
    # Joint limits and order of the ExoMotus X2 in CANOpenRobotController.
    assert package_degrees(CORC_X2, KNEE, -120.0) == pytest.approx(120.0)
    assert package_degrees(CORC_X2, HIP, 120.0) == pytest.approx(120.0)
    order = sorted(CORC_X2.columns.items(), key=lambda item: item[1])
    assert [key for key, _ in order] == [(side, joint) for side in Side for joint in (HIP, KNEE)]


def test_the_open_source_leg_flexes_its_knee_to_plus_60_and_pushes_off_with_its_ankle_at_minus_20():
    # Set-points of early swing (knee) and late stance (ankle) in opensourceleg's walking example.
    assert package_degrees(OSL, KNEE, 60.0) == pytest.approx(60.0)
    assert package_degrees(OSL, ANKLE, -20.0) == pytest.approx(-20.0)


def test_an_unknown_convention_lists_the_known_conventions():
    with raises(ParameterError, "isb", "twin_gait", "opensim_gait2392", "rajagopal"):
        find_convention("isb")
