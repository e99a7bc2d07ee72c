"""Common parts of the tests: the hypothesis profile, and models that take time to build."""

from __future__ import annotations

import os
import re
from collections.abc import Generator
from typing import TypeVar

import numpy as np
import pytest
from example_robots import twin_joints
from hypothesis import HealthCheck, settings
from tested_copy import copies_in_use, describe_mismatch

from twin_gait.leg_model.joints import LegJoints
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.wearer import Patient
from twin_gait.vocabulary import JointName, PelvisGuide, Side

# Tests are reproducible and have no deadline, because a busy machine is not a failure.
settings.register_profile(
    "twin_gait",
    derandomize=True,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("twin_gait")


def armature() -> dict[JointName, float]:
    """Return the inertia of the drives of TWIN at the joints in [kg·m²].

    The device is read here, because a broken copy of the package must not stop the import of this module.
    """
    from twin_device import HIP_ACTUATOR, KNEE_ACTUATOR

    return {JointName.HIP: HIP_ACTUATOR.armature, JointName.KNEE: KNEE_ACTUATOR.armature}


def pytest_configure(config: pytest.Config) -> None:
    """Stop if the tests would use an older, installed copy of the package instead of the checkout."""
    if not hasattr(config, "workerinput"):  # only once, not in every worker of xdist
        problem = next(filter(None, map(describe_mismatch, copies_in_use())), None)
        if problem:
            pytest.exit(problem, returncode=pytest.ExitCode.USAGE_ERROR)


BROWSER_VARIABLE = "TWIN_GAIT_REQUIRE_BROWSER"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Apply :func:`_require_browser` to the report."""
    return _require_browser((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Apply :func:`_require_browser` to the report."""
    return _require_browser((yield))


Report = TypeVar("Report", pytest.TestReport, pytest.CollectReport)


def _require_browser(report: Report) -> Report:
    """Turn a skip for lack of a browser into a failure if the environment requires a browser."""
    if report.skipped and os.environ.get(BROWSER_VARIABLE) and isinstance(report.longrepr, tuple):
        reason = report.longrepr[2]
        if re.search("chromium|playwright|browser", reason, re.IGNORECASE):
            report.outcome = "failed"
            report.longrepr = f"{BROWSER_VARIABLE} is set, and a test was skipped: {reason}"
    return report


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240607)


@pytest.fixture(scope="session")
def both_legs() -> dict[Side, LegJoints]:
    return {side: twin_joints(side) for side in Side}


@pytest.fixture(scope="session")
def bench_leg() -> dict[Side, LegJoints]:
    return {Side.RIGHT: twin_joints(Side.RIGHT, foot=False)}


@pytest.fixture(scope="session")
def twin(both_legs: dict[Side, LegJoints]) -> LegModel:
    """Return the device alone with both legs and the pelvis fixed in the world."""
    return LegModel("twin.urdf", both_legs, armature=armature())


@pytest.fixture(scope="session")
def bench(bench_leg: dict[Side, LegJoints]) -> LegModel:
    """Return the leg of the device on its test stand."""
    return LegModel("twin_leg.urdf", bench_leg, armature=armature())


@pytest.fixture(scope="session")
def worn_twin(both_legs: dict[Side, LegJoints]) -> LegModel:
    """Return device and default wearer with a pelvis that moves up and down."""
    return LegModel(
        "twin.urdf",
        both_legs,
        patient=Patient(),
        pelvis=PelvisGuide.VERTICAL,
        armature=armature(),
    )
