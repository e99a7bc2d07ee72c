"""Currents that lead or lag the angle: logs in closed form, with a current that is moved in time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from friction_bench import KNEE, WEIGHTS, Noise, bench_log, swing
from twin_device import KNEE_ACTUATOR

from twin_gait.identification.current_delay import delay_warnings, estimate_delay
from twin_gait.identification.identify import IdentificationOptions, identify_tests
from twin_gait.identification.processing import BenchSetup, process_log
from twin_gait.identification.reading import Log, Quantity

BENCH = BenchSetup(actuator=KNEE_ACTUATOR, start_angle=None)
VISCOUS = "viscous_friction_Nms_per_rad"
HALF_PERIOD = 0.0005  # [s]: a current that is logged at the start of the 1 ms in which it is held
COUNTED = Noise(offset=0.0, friction=0.0)  # encoder counts and white noise of the current


def campaign_tests(lead: float, bench: BenchSetup = BENCH, *, seed: int = 2):
    """Three swings with each weight, back and forth at 1.25 Hz; the current is that of ``lead`` later."""
    rng, time, tests = np.random.default_rng(seed), np.arange(4000) / 1000.0, []
    for mass in WEIGHTS:
        for speed in (0.15, 1.3, 2.5):
            phase, state = rng.uniform(0.0, 2.0 * math.pi), rng.bit_generator.state
            log = bench_log(swing(time, speed, 0.8, phase), mass, KNEE, rng, noise=COUNTED)
            rng.bit_generator.state = state
            later = bench_log(swing(time + lead, speed, 0.8, phase), mass, KNEE, rng, noise=COUNTED)
            columns = {
                Quantity.TIME: log["time_s"],
                Quantity.ANGLE: log["position_rad"],
                Quantity.MEASURED_CURRENT: later["measured_current_A"],
            }
            tests.append(process_log(Log("log", columns, mass), bench))
    return tests


def viscous_interval(tests, bench: BenchSetup):
    options = IdentificationOptions(bench=bench, models=("rotational",), cross_validation=False)
    result = identify_tests(tests, options)
    return result.models[0].uncertainty.intervals[VISCOUS], result.warnings


def test_a_leading_current_is_reported_and_after_correction_intervals_contain_the_truth():
    early = campaign_tests(HALF_PERIOD)
    (low, high), warnings = viscous_interval(early, BENCH)
    assert high < KNEE[3]  # the bias that no interval shows
    assert len(warnings) == 1 and "the current leads the angle by" in warnings[0]
    found = estimate_delay(early, BENCH)
    assert abs(found.time - HALF_PERIOD) < found.half_interval < 0.2 * HALF_PERIOD
    delayed = replace(BENCH, current_delay=round(found.time, 5))
    assert f"--current-delay-ms {1e3 * delayed.current_delay:.2f}" in warnings[0]
    tests = campaign_tests(HALF_PERIOD, delayed)
    (low, high), warnings = viscous_interval(tests, delayed)
    assert low < KNEE[3] < high and high - low < 0.02 * KNEE[3]
    assert warnings == ()


@pytest.mark.parametrize("lead", [0.0, -0.002])
def test_the_delay_is_estimated_for_either_sign(lead):
    found = estimate_delay(campaign_tests(lead), BENCH)
    assert abs(found.time - lead) < 1.5 * found.half_interval
    warnings = delay_warnings(campaign_tests(lead), BENCH, IdentificationOptions().processing)
    assert [line.startswith("the current lags the angle by 1.9") for line in warnings] == [True] * (
        lead < 0.0
    )


def test_a_wrong_inertia_is_not_reported_as_a_delay():
    heavy = replace(BENCH, link_inertia=0.1)
    assert delay_warnings(campaign_tests(0.0, heavy), heavy, IdentificationOptions().processing) == []


@pytest.mark.parametrize("rebound", [0.0, 0.5], ids=["falls", "falls with a slow rebound"])
def test_logs_of_one_direction_give_no_estimate(rebound):
    """With a slow rebound many samples move back, but no fast ones."""
    tests = [
        replace(test, used=test.used & (test.velocity > -rebound)) for test in campaign_tests(HALF_PERIOD)
    ]
    assert estimate_delay(tests, BENCH) is None
