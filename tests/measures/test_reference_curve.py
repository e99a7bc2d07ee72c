"""The reference curve has the bits of SciPy's piecewise polynomials, without their import."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.interpolate import BPoly

from twin_gait.measures.reference import CYCLE, FASTEST, SLOWEST, key_events, reference_curve
from twin_gait.vocabulary import JointName


@pytest.mark.parametrize("joint", JointName)
def test_the_curve_equals_scipy_bit_for_bit(joint: JointName) -> None:
    draw = np.random.default_rng(20)
    for speed, height in zip(
        draw.uniform(SLOWEST, FASTEST, size=30), draw.uniform(1.45, 2.0, size=30), strict=True
    ):
        events = key_events(joint, speed=speed, height=height)
        around = np.vstack((events, [CYCLE, *events[0, 1:]]))
        spline = BPoly.from_derivatives(around[:, 0], around[:, 1:])
        percent = np.concatenate((np.linspace(-CYCLE, CYCLE, 201), draw.uniform(0.0, CYCLE, size=200)))
        percent = np.append(percent, around[:, 0])
        curve = reference_curve(joint, percent.reshape(3, -1), speed=speed, height=height)
        assert np.array_equal(curve.ravel(), spline(np.mod(percent, CYCLE)))


def test_a_single_number_is_accepted_as_percent() -> None:
    one = reference_curve(JointName.KNEE, np.array(40.0), speed=0.5, height=1.75)
    assert one.shape == () and 0.0 < float(one) < 0.2


def test_a_run_is_simulated_checked_and_summarised_without_scipy() -> None:
    """Its sub-packages take longer to import than a walk to simulate."""
    code = (
        "import sys\n"
        "from twin_gait.cli import options, simulate\n"
        "from twin_gait.configuration.experiments import load_experiment\n"
        "from twin_gait.runs.stored_run import StoredRun\n"
        "from twin_gait.runs.summary import summarise_run\n"
        "from twin_gait.runs.run_page import render_run_page\n"
        "from twin_gait.simulation.simulator import simulate\n"
        "run = simulate(load_experiment('treadmill_guided', ['duration_s=0.1']).experiment)\n"
        "options.check_table(run.experiment)\n"
        "render_run_page([StoredRun(run, summarise_run(run))])\n"
        "print([name for name in ('scipy', 'matplotlib', 'distributed') if name in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert answer.stdout.strip() == "[]"
