"""What several tests share: the hypothesis profile and models that take a moment to build."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from tested_copy import complaint, copies_in_use

from twin_gait.leg_model import LegJoints, LegModel, PelvisGuide
from twin_gait.parameters import HIP_ACTUATOR, KNEE_ACTUATOR, Patient
from twin_gait.vocabulary import JointName, Side

# Reproducible, and without a deadline: a busy machine is not a failure.
settings.register_profile(
    "twin_gait",
    derandomize=True,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("twin_gait")

ARMATURE = {JointName.HIP: HIP_ACTUATOR.armature, JointName.KNEE: KNEE_ACTUATOR.armature}


def pytest_configure(config: pytest.Config) -> None:
    """An edit of a law must not pass its tests because an older, installed copy was tested."""
    if not hasattr(config, "workerinput"):  # once, not in every worker of xdist
        problem = next(filter(None, map(complaint, copies_in_use())), None)
        if problem:
            pytest.exit(problem, returncode=pytest.ExitCode.USAGE_ERROR)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240607)


@pytest.fixture(scope="session")
def both_legs() -> dict[Side, LegJoints]:
    return {side: LegJoints.of_twin(side) for side in Side}


@pytest.fixture(scope="session")
def bench_leg() -> dict[Side, LegJoints]:
    return {Side.RIGHT: LegJoints.of_twin(Side.RIGHT, foot=False)}


@pytest.fixture(scope="session")
def twin(both_legs: dict[Side, LegJoints]) -> LegModel:
    """The device alone with both legs, pelvis fixed in the world."""
    return LegModel("twin.urdf", both_legs, armature=ARMATURE)


@pytest.fixture(scope="session")
def bench(bench_leg: dict[Side, LegJoints]) -> LegModel:
    """The device's leg on its stand."""
    return LegModel("twin_leg.urdf", bench_leg, armature=ARMATURE)


@pytest.fixture(scope="session")
def worn_twin(both_legs: dict[Side, LegJoints]) -> LegModel:
    """Device and default wearer, pelvis free to move up and down."""
    return LegModel(
        "twin.urdf",
        both_legs,
        patient=Patient(),
        pelvis=PelvisGuide.VERTICAL,
        armature=ARMATURE,
    )
