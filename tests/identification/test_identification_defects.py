"""Series as others record them: what is mended, what is doubted, what is refused; soft stops; the loss.

All data are synthetic, made by formulas of these tests.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from errors import raises
from friction_bench import KNEE, rotational
from numpy.testing import assert_allclose

from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.identification import identify
from twin_gait.identification.fitting import FitOptions, fit_model
from twin_gait.identification.identify import IdentificationOptions, identify_logs
from twin_gait.identification.laws import MODELS
from twin_gait.identification.models import FrictionTest, join_tests
from twin_gait.identification.processing import process_log
from twin_gait.identification.reading import ColumnOptions, Quantity, read_log
from twin_gait.identification.signals import soft_stop

TIME = 0.01 * np.arange(1000)
VELOCITY = np.sin(0.7 * TIME) + 0.3 * np.sin(2.3 * TIME)
TORQUE = 3.0 * np.sign(VELOCITY) + 2.0 * VELOCITY
NAMES = {Quantity.TIME: "t", Quantity.VELOCITY: "dq2", Quantity.FRICTION_TORQUE: "tau2"}


def text_of(separator: str = ",", **columns: np.ndarray) -> str:
    given = {"t": TIME, "dq2": VELOCITY, "tau2": TORQUE, **columns}
    rows = [
        separator.join(f"{x:.9g}" if math.isfinite(x) else "" for x in row)
        for row in zip(*given.values(), strict=True)
    ]
    return "\n".join([separator.join(given), *rows]) + "\n"


def identified(path, text: str, model: str = "coulomb_viscous"):
    path.write_text(text)
    options = IdentificationOptions(columns=ColumnOptions(names=NAMES), models=(model,))
    return identify_logs([path], options)


MENDED = {
    "no clock": (text_of(t=np.zeros(1000)), "time was left out: is the same in every row"),
    "disorder": (text_of(t=np.random.default_rng(0).permutation(TIME)), "time was left out: goes back"),
    "milliseconds": (text_of(t=1000.0 * TIME), "time advances by 10 s from row to row"),
    "sparse temperature": (
        text_of(temperature=np.where(np.arange(1000) % 50, math.nan, 30.0)),
        "temperature was left out: 98 % of its cells are empty",
    ),
    "another angle": (text_of(q=np.cos(TIME)), "angle was left out: the velocity's integral"),
}


@pytest.mark.parametrize("name", MENDED)
def test_a_defect_of_a_series_is_repaired_and_reported(tmp_path, name):
    text, warning = MENDED[name]
    result = identified(tmp_path / "a.csv", text)
    assert any(warning in line for line in result.warnings)
    fit = result.models[0].fit
    assert_allclose(list(fit.model.parameters(fit.x).values()), [3.0, 2.0], rtol=1e-6)
    assert len(result.samples) == 1000


@pytest.mark.parametrize(
    "before", ["Robot: arm\nDate: 2024-01-01\n\n", "% exported\n% by a program\n", "# comment\n"]
)
def test_lines_before_the_column_names_are_skipped(tmp_path, before):
    assert len(identified(tmp_path / "a.csv", before + text_of()).samples) == 1000


REFUSED = {
    "line of unknown units": (
        text_of().replace("tau2\n", "tau2\ns,deg/s,lbft\n"),
        ("t", "row 1", "s"),
    ),
    "dates": (
        text_of().replace("\n0,", "\n2024-01-01,"),
        ("t", "row 1", "2024-01-01"),
    ),
    "mark": (text_of(tau2=np.where(np.arange(1000) == 5, -9999.0, TORQUE)), ("friction_torque", "-9999")),
    "unit": (text_of().replace("dq2", "dq2 [counts/s]"), ("dq2 [counts/s]", "velocity", "rad/s", "--units")),
    "standing": (text_of(dq2=np.where(np.arange(1000) == 7, 0.3, 0.0)), ("logs", "1", "0.3 rad/s", "6")),
}


@pytest.mark.parametrize("name", REFUSED)
def test_defects_that_falsify_the_result_are_refused_in_one_line(tmp_path, name):
    text, message = REFUSED[name]
    with raises((ParameterFileError, ParameterError), *message) as error:
        identified(tmp_path / "a.csv", text)
    assert "\n" not in str(error.value)


def test_consecutive_records_are_separated(tmp_path):
    samples = identified(tmp_path / "a.csv", text_of(t=np.tile(TIME[:250], 4))).samples
    assert np.flatnonzero(samples.fresh).tolist() == [0, 250, 500, 750]


def test_one_column_cannot_be_two_quantities(tmp_path):
    (tmp_path / "a.csv").write_text(text_of())
    with raises(ParameterFileError, "dq2", "friction_torque"):
        read_log(
            tmp_path / "a.csv",
            ColumnOptions(names={Quantity.VELOCITY: "dq2", Quantity.FRICTION_TORQUE: "dq2"}),
        )


def test_a_velocity_in_degrees_is_warned_of_in_a_series(tmp_path):
    result = identified(tmp_path / "a.csv", text_of(dq2=np.degrees(VELOCITY)))
    assert any("velocity reaches" in line and "velocity=deg/s" in line for line in result.warnings)


def test_the_loss_ignores_isolated_outliers_only():
    rng = np.random.default_rng(1)
    noisy = TORQUE + 0.1 * rng.normal(size=1000)
    spikes = np.where(np.arange(1000) % 97 == 5, 20.0, 0.0)
    bump = np.where((TIME > 4.0) & (TIME < 4.6), 3.0, 0.0)
    used = np.ones(1000, dtype=bool)
    thresholds = [
        fit_model(
            MODELS["coulomb_viscous"], join_tests([FrictionTest("", VELOCITY, torque, used)]), FitOptions()
        ).threshold
        for torque in (noisy, noisy + spikes, noisy + bump)
    ]
    assert [math.isinf(item) for item in thresholds] == [True, False, True]


@pytest.mark.parametrize("stiffness", [300.0, 2000.0])
def test_a_soft_stop_is_detected_and_a_deceleration_is_not(stiffness):
    time = np.arange(300) * 0.01
    speed = np.where(time < 2.0, 0.5 * (1.0 - np.exp(-time / 0.3)), 0.5 * np.exp(-(time - 2.0) / 0.15))
    angle = np.cumsum(speed) * 0.01
    inertial = 3.4 * np.gradient(speed, 0.01)
    friction = 3.0 * np.tanh(50.0 * speed) + 2.0 * speed
    touched = float(np.interp(2.0, time, angle))
    spring = stiffness * np.maximum(angle - touched, 0.0)
    assert not soft_stop(angle, speed, friction, inertial).any()
    found = soft_stop(angle, speed, friction + spring + np.abs(inertial) * (spring > 0), inertial)
    assert spring[~found].max() < 1.0
    assert not found[angle < touched - 0.02].any()


def test_bootstrap_of_one_file_accepts_draws_without_slow_samples(tmp_path):
    # Two seconds pass the slow speeds a few times only: some of the draws of stretches miss them all.
    rng, time = np.random.default_rng(0), 0.001 * np.arange(2000)
    velocity = 1.5 * np.sin(0.8 * math.pi * time) + 0.5 * np.sin(0.074 * math.pi * time)
    torque = rotational(velocity, KNEE) + 0.1 * rng.normal(size=len(time))
    found = identified(tmp_path / "a.csv", text_of(t=time, dq2=velocity, tau2=torque), "rotational")
    model = found.models[0]
    standard = model.uncertainty.standard_errors
    for (name, (low, high)), truth in zip(
        model.uncertainty.intervals.items(), (KNEE[0], KNEE[1], KNEE[3], KNEE[2]), strict=True
    ):
        assert low < truth < high, name
        # White noise: ordinary theory is right, and stretches of time can only be a few times less sure.
        assert high - low < 4.0 * 2.0 * 1.96 * standard[name], name


def test_excess_samples_are_thinned_evenly(tmp_path, monkeypatch):
    monkeypatch.setattr(identify, "MAX_SAMPLES", 300)
    found = identified(tmp_path / "a.csv", text_of())
    assert_allclose(found.samples.velocity, VELOCITY[::4], atol=1e-8)
    assert_allclose(list(found.models[0].fit.x), [3.0, 2.0], atol=1e-6)


def test_processing_keeps_every_sample_of_a_series(tmp_path):
    (tmp_path / "a.csv").write_text(text_of(t=np.floor(TIME * 20.0) / 20.0))
    log = read_log(tmp_path / "a.csv", ColumnOptions(names=NAMES))
    assert len(process_log(log, None)) == 1000
