"""From logs to friction torques: filters, balance of torques, stops, formats, units, mistakes.

The logs are synthetic, made in closed form by friction_bench.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from friction_bench import (
    ARMATURE,
    GRAVITY,
    KNEE,
    LEVER,
    LINK_INERTIA,
    QUIET,
    bench_log,
    campaign,
    fall,
    rotational,
    swing,
    write_log,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from twin_device import KNEE_ACTUATOR

from twin_gait.exceptions import ParameterError, ParameterFileError, TwinGaitError
from twin_gait.identification.identify import IdentificationOptions, identify_logs, identify_tests
from twin_gait.identification.processing import BenchSetup, Processing, process_log
from twin_gait.identification.reading import ColumnOptions, Log, Quantity, read_log
from twin_gait.identification.signals import moving_average, zero_phase
from twin_gait.worlds.bench_joint import LoadAngle

ROTATIONAL = (
    "breakaway_torque_Nm",
    "coulomb_friction_Nm",
    "breakaway_velocity_rad_per_s",
    "viscous_friction_Nms_per_rad",
)
BENCH = BenchSetup(actuator=KNEE_ACTUATOR, start_angle=None)
TIME = np.arange(5000) / 1000.0
NAMES = {
    "time_s": Quantity.TIME,
    "position_rad": Quantity.ANGLE,
    "velocity_rad_per_s": Quantity.VELOCITY,
    "measured_current_A": Quantity.MEASURED_CURRENT,
    "target_current_A": Quantity.TARGET_CURRENT,
}


def as_log(columns: dict[str, np.ndarray], mass: float | None = 2.0) -> Log:
    return Log("log", {NAMES[name]: values for name, values in columns.items() if name in NAMES}, mass)


def quiet(motion, mass: float = 2.0) -> dict[str, np.ndarray]:
    return bench_log(motion, mass, KNEE, np.random.default_rng(0), noise=QUIET)


def test_torque_balance_recovers_the_friction_of_the_bench():
    test = process_log(as_log(quiet(swing(TIME, 0.6, 3.0, 0.4))), BENCH)
    expected = rotational(test.velocity, KNEE)
    assert test.used.sum() > 400
    assert np.abs(test.torque - expected)[test.used].max() < 0.06
    assert_allclose(test.load, 2.0 * GRAVITY * LEVER * np.cos(test.angle - math.pi / 2), atol=1e-3)


def test_printed_load_angle_and_inertia_have_the_predicted_error():
    columns = quiet(swing(TIME, 0.6, 3.0, 0.4))
    right = process_log(as_log(columns), BENCH)
    printed = process_log(
        as_log(columns),
        BenchSetup(actuator=KNEE_ACTUATOR, start_angle=None, load_angle=LoadAngle.PRINTED),
    )
    weight = 2.0 * GRAVITY * LEVER
    difference = weight * (np.cos(right.angle) - np.cos(right.angle - math.pi / 2))
    assert_allclose((printed.torque - right.torque)[10:-10], difference[10:-10], atol=2e-3)
    wrong = BenchSetup(actuator=KNEE_ACTUATOR, mass_as_printed=True)
    assert_allclose(wrong.inertia(2.0) - BENCH.inertia(2.0), 2.0 * (LEVER - LEVER**2))
    assert_allclose(BENCH.inertia(2.0), ARMATURE + LINK_INERTIA + 2.0 * LEVER**2)


def test_the_first_angle_is_set_to_ninety_degrees():
    columns = quiet(swing(TIME, 0.6, 3.0, 0.4))
    shifted = {**columns, "position_rad": columns["position_rad"] - columns["position_rad"][0] + 17.0}
    set_to = BenchSetup(actuator=KNEE_ACTUATOR, start_angle=columns["position_rad"][0])
    one = process_log(as_log(columns), BENCH)
    other = process_log(as_log(shifted), set_to)
    assert_allclose(other.torque, one.torque, atol=1e-9)


def test_zero_phase_filter_has_no_delay_and_the_moving_average_is_late_by_four_and_a_half_samples():
    time = np.arange(3000) / 1000.0
    wave = np.sin(2 * np.pi * 1.3 * time)
    assert np.abs(zero_phase(wave, 40.0, 1000.0) - wave)[100:-100].max() < 1e-5
    slow = np.sin(2 * np.pi * 0.8 * np.arange(600) / 100.0)
    # A mean of ten: late by 4.5 samples, smaller by the Dirichlet kernel.
    share = math.sin(10 * math.pi * 0.008) / (10 * math.sin(math.pi * 0.008))
    late = share * np.sin(2 * np.pi * 0.8 * (np.arange(600) - 4.5) / 100.0)
    assert_allclose(moving_average(slow, 10)[20:], late[20:], atol=1e-12)
    assert_allclose(moving_average(np.array([1.0, 3.0, 5.0]), 2), [1.0, 2.0, 4.0])


def test_zero_phase_filter_halves_the_amplitude_at_its_cutoff():
    time = np.arange(4000) / 1000.0
    wave = np.sin(2 * np.pi * 40.0 * time)
    assert_allclose(np.abs(zero_phase(wave, 40.0, 1000.0)[500:-500]).max(), 0.5, rtol=0.01)


@pytest.mark.parametrize("speed", [0.35, 0.38, 0.4, 0.45, 0.5, 0.6])
def test_stops_stand_still_and_edges_are_rejected_and_counted(speed):
    motion = fall(TIME, speed)
    test = process_log(as_log(quiet(motion)), BENCH)
    counts, stopped = test.counts, np.radians(125.0)
    assert counts["used"] + counts["stop"] + counts["standstill"] + counts["reversal"] + counts[
        "edge"
    ] == len(test)
    assert counts["stop"] > 100
    assert not test.used[test.angle > stopped - 0.005].any()
    assert np.abs(test.torque - rotational(test.velocity, KNEE))[test.used].max() < 0.06
    assert np.abs(test.torque)[~test.used].max() > 5.0  # the impact that must not be fitted


def test_the_thesis_pipeline_finds_the_same_stops_and_is_biased_by_its_late_velocity():
    """One-way drops, nothing noisy: the break-away velocity comes out wrong, and zero phase right."""
    errors = {}
    for processing in (Processing.ZERO_PHASE, Processing.THESIS):
        options = processing
        drops = campaign(3, tests=3, two_way=False, duration=3.0, noise=QUIET)
        tests = [process_log(as_log(log, mass), BENCH, options) for mass, log in drops]
        assert all(test.counts["stop"] > 50 for test in tests)
        choice = IdentificationOptions(models=("rotational",), cross_validation=False)
        found = identify_tests(tests, choice)
        assert any("one direction only" in line for line in found.warnings)
        values = found.models[0].fit.model.parameters(found.models[0].fit.x)
        errors[processing] = max(
            abs(values[name] / value - 1) for name, value in zip(ROTATIONAL, KNEE, strict=True)
        )
    assert errors[Processing.ZERO_PHASE] < 0.03
    assert errors[Processing.THESIS] > 0.2


def test_standstill_without_an_impact_is_counted_separately():
    angle, velocity, acceleration = swing(TIME, 0.4, 3.0, -math.pi / 2)
    pause = np.concatenate([np.full(2000, angle[0]), angle])
    still = np.zeros(2000)
    motion = (pause, np.concatenate([still, velocity]), np.concatenate([still, acceleration]))
    test = process_log(as_log(quiet(motion)), BENCH)
    assert 170 <= test.counts["standstill"] <= 230


def test_the_thesis_uses_the_target_current_and_zero_phase_the_measured_one_if_logged():
    columns = quiet(swing(TIME, 0.6, 3.0, 0.4))
    columns["target_current_A"] = columns["target_current_A"] + 0.1
    measured = process_log(as_log(columns), BENCH)
    only = {name: values for name, values in columns.items() if "measured" not in name}
    target = process_log(as_log(only), BENCH)
    assert_allclose(target.torque - measured.torque, 0.1 * 7.05, rtol=1e-6)
    thesis = process_log(as_log(columns), BENCH, Processing.THESIS)
    assert np.median(thesis.torque[thesis.used]) > np.median(measured.torque[measured.used])


def test_the_thesis_pipeline_is_biased_and_zero_phase_is_not():
    """Its velocity is 45 ms late against current and load: worst at the break-away velocity."""
    errors = {}
    for processing in (Processing.ZERO_PHASE, Processing.THESIS):
        options = processing
        tests = [
            process_log(as_log(log, mass), BENCH, options) for mass, log in campaign(3, tests=4, noise=QUIET)
        ]
        choice = IdentificationOptions(models=("rotational",), cross_validation=False)
        found = identify_tests(tests, choice).models[0]
        errors[processing] = abs(
            found.fit.model.parameters(found.fit.x)["breakaway_velocity_rad_per_s"] / 0.2031 - 1
        )
    assert errors[Processing.ZERO_PHASE] < 0.003
    assert errors[Processing.THESIS] > 0.02


def test_a_campaign_of_files_recovers_table_3_1(tmp_path):
    paths = [
        write_log(tmp_path / f"knee_{mass:g}kg_{number}.log", columns)
        for number, (mass, columns) in enumerate(campaign(2, tests=3, duration=4.0))
    ]
    options = IdentificationOptions(bench=BENCH, models=("rotational", "coulomb_viscous"))
    result = identify_logs(paths, options)
    best = result.models[0]
    assert best.name == "rotational"
    assert {test.mass for test in result.tests} == {1.0, 1.5, 2.0, 2.5, 3.0}
    assert [run.left_out for run in best.validations] == ["files", "weight"]
    assert len(best.uncertainty.intervals) == 4
    for name, value in zip(ROTATIONAL, KNEE, strict=True):
        low, high = best.uncertainty.intervals[name]
        assert abs(0.5 * (low + high) - value) < high - low < 0.25 * value


def misread(signs: dict[str, float], shift: float = 0.0, lever: float = LEVER):
    """The campaign above, with columns turned, angles moved and the lever taken for another."""
    bench = replace(BENCH, lever=lever)
    tests = []
    for mass, columns in campaign(2, tests=3, duration=4.0):
        logged = {name: signs.get(name, 1.0) * values for name, values in columns.items()}
        turn = signs.get("position_rad", 1.0)  # about the horizontal, where the bench sets its angle
        logged["position_rad"] += 0.5 * math.pi * (1.0 - turn) + shift
        tests.append(process_log(as_log(logged, mass), bench))
    options = IdentificationOptions(bench=bench, models=("coulomb_viscous",), cross_validation=False)
    warned = [line for line in identify_tests(tests, options).warnings if "weight's torque" in line]
    return warned[0] if warned else None


@pytest.mark.parametrize(
    ("degrees", "lever"), [(20.0, LEVER), (-30.0, LEVER), (0.0, 0.8 * LEVER), (0.0, 1.4 * LEVER)]
)
def test_a_load_that_contradicts_the_current_is_reported_with_its_size_and_angle(degrees, lever):
    message = misread({}, math.radians(degrees), lever)
    gain, tilt = re.search(r"is ([\d.]+) times.*angle ([+-]\d+)°", message).groups()
    # A wrong lever is also a wrong inertia, which looks like a few degrees.
    assert float(gain) == pytest.approx(LEVER / lever, abs=0.02 if lever == LEVER else 0.06)
    assert float(tilt) == pytest.approx(degrees, abs=1.0 if lever == LEVER else 12.0)


def test_an_approximately_correct_load_causes_no_warning():
    assert misread({}) is None
    assert misread({}, math.radians(3.0), 1.05 * LEVER) is None


@pytest.mark.parametrize(
    ("turned", "message"),
    [
        (["measured_current_A"], ("logs", "--columns", "measured_current=-NAME", "angle=-NAME")),
        (
            ["position_rad", "velocity_rad_per_s"],
            ("logs", "--columns", "measured_current=-NAME", "angle=-NAME"),
        ),
        (
            ["measured_current_A", "position_rad", "velocity_rad_per_s"],
            ("logs", "--columns", "measured_current=-NAME,angle=-NAME"),
        ),
    ],
)
def test_a_wrong_sign_is_refused_and_not_fitted_as_friction(turned, message):
    with raises(ParameterError, *message):
        misread(dict.fromkeys(turned, -1.0))


SERIES = "t;dq2;tau2\n" + "\n".join(
    f"{0.01 * i};{math.sin(i / 9):.6f};{2 * math.sin(i / 9):.6f}" for i in range(60)
)
NAMED = ColumnOptions(names={Quantity.TIME: "t", Quantity.VELOCITY: "dq2", Quantity.FRICTION_TORQUE: "tau2"})


@pytest.mark.parametrize(
    "text",
    [
        SERIES,
        SERIES.replace(";", ","),
        SERIES.replace(";", "\t"),
        SERIES.replace(";", "  "),
        SERIES.replace("\n", "\r\n"),
        "\ufeff" + SERIES,
        "# made by a test\n\n" + SERIES,
        SERIES.replace(".", ","),
        SERIES + "\n\n",
    ],
)
def test_a_series_is_read_with_any_separator(tmp_path, text):
    path = tmp_path / "series.csv"
    path.write_text(text, encoding="utf-8")
    log = read_log(path, NAMED)
    assert_allclose(log.columns[Quantity.VELOCITY], np.sin(np.arange(60) / 9), atol=1e-6)
    assert_allclose(process_log(log, None).torque, 2 * np.sin(np.arange(60) / 9), atol=1e-6)


def test_units_come_from_the_name_the_brackets_or_the_user(tmp_path):
    path = tmp_path / "a.csv"
    rows = "\n".join(f"{10 * i},{30 * math.sin(i)},{2000 * math.sin(i)}" for i in range(30))
    path.write_text("time_ms,velocity [deg/s],torque\n" + rows)
    names = {Quantity.FRICTION_TORQUE: "torque"}
    log = read_log(path, ColumnOptions(names=names, units={Quantity.FRICTION_TORQUE: "mNm"}))
    assert_allclose(log.columns[Quantity.TIME], 0.01 * np.arange(30))
    assert_allclose(log.columns[Quantity.VELOCITY], np.radians(30 * np.sin(np.arange(30))))
    assert_allclose(log.columns[Quantity.FRICTION_TORQUE], 2 * np.sin(np.arange(30)))
    with raises(ParameterFileError, "deg/s", "--units velocity=rad/s"):
        read_log(path, ColumnOptions(units={Quantity.VELOCITY: "rad/s"}))
    with raises(ParameterFileError, "furlong", "velocity", "rad/s"):
        read_log(path, ColumnOptions(units={Quantity.VELOCITY: "furlong"}))


def test_a_requested_column_is_not_used_for_another_quantity(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time_s,measured_current_A,target_current_A\n" + "\n".join(f"{i},1,2" for i in range(30)))
    log = read_log(path, ColumnOptions(names={Quantity.MEASURED_CURRENT: "target_current_A"}))
    assert set(log.columns) == {Quantity.TIME, Quantity.MEASURED_CURRENT}
    assert (log.columns[Quantity.MEASURED_CURRENT] == 2.0).all()


def test_a_file_without_names_has_numbered_columns_and_a_minus_negates(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("\n".join(f"{math.sin(i)} {-3 * math.sin(i)}" for i in range(30)))
    log = read_log(path, ColumnOptions(names={Quantity.VELOCITY: "1", Quantity.FRICTION_TORQUE: "-2"}))
    assert_allclose(log.columns[Quantity.FRICTION_TORQUE], 3 * np.sin(np.arange(30)))


@pytest.mark.parametrize(
    ("name", "mass"), [("knee_2.5kg_3.log", 2.5), ("k2p0 kg.log", 2.0), ("knee_3.log", None)]
)
def test_the_weight_comes_from_the_name(tmp_path, name, mass):
    path = tmp_path / name
    path.write_text(SERIES)
    assert read_log(path, NAMED).mass == mass


def changed(columns: dict[str, np.ndarray], **others) -> dict[str, np.ndarray]:
    return {**columns, **others}


SWING = quiet(swing(TIME, 0.6, 3.0, 0.4))


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            changed(SWING, position_rad=np.degrees(SWING["position_rad"])),
            ("angle", "118.1 rad", "--units angle=deg"),
        ),
        (
            changed(SWING, velocity_rad_per_s=np.degrees(SWING["velocity_rad_per_s"])),
            ("angle", "57.3"),
        ),
        (changed(SWING, velocity_rad_per_s=-SWING["velocity_rad_per_s"]), ("angle", "-1")),
        (changed(SWING, time_s=1000 * SWING["time_s"]), ("angle", "1e+03", "--units")),
        (
            changed(SWING, measured_current_A=1000 * SWING["measured_current_A"] + 300),
            ("measured_current", "A", "--units", "measured_current=mA"),
        ),
        (changed(SWING, time_s=SWING["time_s"][::-1]), ("time", "4999", "4.999 s", "4.998 s")),
        (changed(SWING, time_s=np.floor(SWING["time_s"] * 100) / 100), ("time",)),
        (
            changed(SWING, position_rad=np.full(5000, 1.0), velocity_rad_per_s=np.zeros(5000)),
            ("angle", "1"),
        ),
        ({name: values[:40] for name, values in SWING.items()}, ("time", "0.04 s", "0.12")),
        ({name: values[:5] for name, values in SWING.items()}, ("5", "20")),
        (
            {name: values for name, values in SWING.items() if name != "position_rad"},
            ("angle", "--columns angle=NAME"),
        ),
        (
            {name: values for name, values in SWING.items() if "current" not in name},
            ("measured_current", "--columns measured_current=NAME"),
        ),
    ],
)
def test_a_log_that_cannot_be_used_is_refused_in_one_line(columns, message):
    with raises(ParameterFileError, *message) as error:
        process_log(as_log(columns), BENCH)
    assert "\n" not in str(error.value)


def test_a_log_without_a_weight_is_refused():
    with raises(ParameterFileError, "mass", "--mass"):
        process_log(as_log(SWING, None), BENCH)


def test_gaps_duplicates_and_nan_do_not_change_the_friction():
    whole = process_log(as_log(SWING), BENCH)
    rows = np.setdiff1d(np.arange(5000), np.arange(2000, 2300))
    holed = {name: values[rows].copy() for name, values in SWING.items()}
    holed["measured_current_A"][100] = math.nan
    holed = {name: np.insert(values, 500, values[500]) for name, values in holed.items()}
    test = process_log(as_log(holed), BENCH)
    assert (test.counts["not_a_number"], test.counts["duplicate_time"]) == (1, 1)
    assert test.counts["edge"] > whole.counts["edge"] + 28
    expected = rotational(test.velocity, KNEE)
    assert np.abs(test.torque - expected)[test.used].max() < 0.1


def test_single_missing_rows_lose_no_samples():
    whole = process_log(as_log(SWING), BENCH)
    holed = {name: values.copy() for name, values in SWING.items()}
    missing = np.random.default_rng(0).choice(5000, 100, replace=False)
    holed["measured_current_A"][missing] = math.nan
    test = process_log(as_log(holed), BENCH)
    assert test.counts["not_a_number"] == 100
    assert test.used.sum() > 0.98 * whole.used.sum()
    both = test.used & whole.used
    assert np.abs(test.torque - whole.torque)[both].max() < 0.02


def test_reasons_for_rejected_samples_are_reported():
    noisy = dict(SWING, position_rad=SWING["position_rad"] + np.random.default_rng(0).normal(0.0, 2e-3, 5000))
    options = IdentificationOptions(bench=BENCH, models=("coulomb_viscous",))
    with raises(ParameterError, 0, 500, "495 by stop", "0 by standstill", "0 by reversal", "5 by edge"):
        identify_tests([process_log(as_log(noisy), BENCH)], options)


def test_fifty_rows_a_second_are_enough():
    slow = {name: values[::20] for name, values in SWING.items()}
    test = process_log(as_log(slow), BENCH)
    assert np.abs(test.torque - rotational(test.velocity, KNEE))[test.used].max() < 0.3


@pytest.mark.parametrize("column", ["velocity", "friction_torque"])
def test_a_constant_column_is_refused(column):
    values = {Quantity.VELOCITY: np.sin(np.arange(50)), Quantity.FRICTION_TORQUE: np.cos(np.arange(50))}
    values[Quantity(column)] = np.full(50, 0.5)
    with raises(ParameterFileError, column, 0.5):
        process_log(Log("log", values), None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ("bad.csv",)),
        ("# only a comment\n", ("bad.csv",)),
        ("a,b\n1,2\n", ("a, b", "--columns")),
        ("velocity,friction_torque\n", ("0", "20")),
        (
            "velocity,friction_torque\n1,2\n3,x\n",
            ("friction_torque", "row 2", "x"),
        ),
        (
            "velocity,friction_torque\n1,2\n3,inf\n",
            ("friction_torque", "row 2", "inf"),
        ),
        ("velocity,velocity,friction_torque\n1,2,3\n", ("velocity", "2")),
        ("velocity,friction_torque\n1,2,3\n4,5,6,7\n", ("line 2", "2", "3")),
    ],
)
def test_a_malformed_file_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    columns = ColumnOptions(names={Quantity.VELOCITY: "velocity"} if "velocity,velocity" in text else {})
    with raises(ParameterFileError, *message) as error:
        process_log(read_log(path, columns), None)
    assert "\n" not in str(error.value) and "bad.csv" in str(error.value)


def test_a_binary_file_and_a_missing_one_are_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(b"\x00\x01\x02" * 100)
    with raises(ParameterFileError, "a.csv", "UTF-8"):
        read_log(path)
    path.write_bytes(b"\xe9\xfe velocity")
    with raises(ParameterFileError, "UTF-8"):
        read_log(path)
    with raises(ParameterFileError, "none.csv", "Errno 2"):
        read_log(tmp_path / "none.csv")


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    data=st.one_of(
        st.binary(max_size=300),
        st.text(alphabet='0123456789.,;\t -+eE"#\nvelocityfrictiontorquenan', max_size=400).map(str.encode),
        st.lists(
            st.lists(st.sampled_from(["1", "-2.5", "", "nan", "x", '"', "1e400", "#"]), max_size=5),
            max_size=40,
        ).map(
            lambda rows: ("velocity,friction_torque\n" + "\n".join(",".join(row) for row in rows)).encode()
        ),
    )
)
def test_any_file_is_read_or_refused_in_one_line(tmp_path, data):
    path = tmp_path / "fuzz.csv"
    path.write_bytes(data)
    try:
        test = process_log(read_log(path), None)
    except TwinGaitError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(test.velocity).all() and np.isfinite(test.torque).all()
