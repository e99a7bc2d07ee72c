"""The network section: units, words for a mapping, outages, and mistakes that end in one line."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from errors import raises, states

from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.experiments import experiment_from_mapping, load_experiment
from twin_gait.exceptions import ParameterError, ParameterFileError, TwinGaitError
from twin_gait.parameters.network import (
    ImpedanceLocation,
    NetworkParameters,
    Outage,
    OutageKind,
    parse_outage,
)

OUTAGES = ["reboot:left_knee@4.2s=0.3s", "silence@5s=200ms", "silence:ccu@5s", "bus_off:right_hip@3s"]


def network_of(*settings: str, preset: str = "treadmill_guided") -> NetworkParameters | None:
    return load_experiment(preset, settings).experiment.network


def test_without_the_section_or_with_the_word_ideal_the_bus_is_ideal() -> None:
    for settings in ((), ("network=ideal",), ("network={kind: ideal}",)):
        loaded = load_experiment("treadmill_guided", settings).experiment
        assert loaded.network is None
        assert experiment_document(loaded)["network"] == "ideal"
        assert loaded == load_experiment("treadmill_guided").experiment


def test_the_word_can_selects_the_defaults() -> None:
    assert network_of("network=can") == NetworkParameters()
    assert network_of("network.loss=0.1") == NetworkParameters(loss=0.1)


def test_values_are_converted_to_si_and_survive_being_written_and_read(tmp_path: Path) -> None:
    path = tmp_path / "bus.yaml"
    path.write_text(
        "preset: treadmill_guided\n"
        "network:\n"
        "  bit_rate_kbit_per_s: 500\n"
        "  cycle_ms: 4\n"
        "  phase_us: {left_knee: 250, right_hip: 0}\n"
        "  clock_drift_ppm: {right_knee: -50}\n"
        "  jitter_us: 100\n"
        "  error_share: 0.01\n"
        "  bus_off_recovery: false\n"
        "  impedance: ccu\n"
        "  board_timeout_ms: 10\n"
        f"  outages: [{', '.join(OUTAGES)}]\n"
    )
    loaded = load_experiment(path)
    network = loaded.experiment.network
    assert network is not None
    assert network.bit_rate == 500e3 and network.cycle == pytest.approx(4e-3)
    assert network.phase == pytest.approx({"left_knee": 2.5e-4, "right_hip": 0.0})
    assert network.clock_drift == pytest.approx({"right_knee": -5e-5})
    assert network.jitter == pytest.approx(1e-4) and network.board_timeout == pytest.approx(0.01)
    assert network.ccu_timeout == NetworkParameters.ccu_timeout
    assert (network.error_share, network.bus_off_recovery) == (0.01, False)
    assert network.impedance is ImpedanceLocation.CCU
    assert [item.kind for item in network.outages] == ["reboot", "silence", "silence", "bus_off"]
    # As typed, every default filled in once, and in SI.
    assert loaded.document["network"]["jitter_us"] == 100
    assert "jitter_s" not in loaded.document["network"]
    for document in (loaded.document, experiment_document(loaded.experiment)):
        assert experiment_from_mapping(document, "again", tmp_path) == loaded.experiment


def test_a_dbc_file_is_found_next_to_the_experiment(tmp_path: Path) -> None:
    (tmp_path / "own.dbc").write_text('VERSION ""\n')
    (tmp_path / "bus.yaml").write_text("preset: treadmill_guided\nnetwork: {dbc: own.dbc}\n")
    network = load_experiment(tmp_path / "bus.yaml").experiment.network
    assert network is not None and network.dbc == str(tmp_path / "own.dbc")


@pytest.mark.parametrize("text", OUTAGES)
def test_an_outage_is_read_as_it_is_written(text: str) -> None:
    found = parse_outage(text)
    assert parse_outage(str(found)) == found
    assert found.time == float(text.partition("@")[2].partition("s")[0])
    durations = dict(zip(OUTAGES, (0.3, 0.2, math.inf, math.inf), strict=True))
    assert found.duration == pytest.approx(durations[text])


@pytest.mark.parametrize(
    ("text", "facts"),
    [
        ("reboot", ("KIND:NODE@TIMEs=DURATIONs",)),
        ("boot:ccu@3s", ("silence", "reboot", "bus_off")),
        ("reboot@3s", ("node", "ccu", "left_hip")),
        ("reboot:left_foot@3s", ("node", "ccu", "left_hip")),
        ("silence@3s=-1s", ("duration", "0", "-1.0")),
        ("silence@soons", ("KIND:NODE@TIMEs=DURATIONs",)),
        ("bus_off:ccu@3s=2s", ("bus_off_recovery",)),
    ],
)
def test_an_inconsistent_outage_is_refused(text: str, facts: tuple[str, ...]) -> None:
    with pytest.raises(ParameterError) as caught:
        parse_outage(text)
    assert states(str(caught.value), repr(text), *facts)


@pytest.mark.parametrize(
    ("setting", "facts"),
    [
        ("network=5", ("network", "5")),
        ("network=star", ("network", "ideal", "can", "star")),
        ("network={kind: ideal, loss: 0.1}", ("ideal", "can")),
        ("network.los=0.1", ("network.los", "loss")),
        ("network.loss=2", ("network.loss", "0", "1", "2")),
        ("network.error_share=-1", ("network.error_share", "0", "1", "-1")),
        ("network.bit_rate_kbit_per_s=2000", ("network.bit_rate_kbit_per_s", "10", "1000", "2000")),
        ("network.cycle_ms=0.5", ("network.cycle_ms", "1", "100", "0.5 ms")),
        ("network.jitter_us=3000", ("network", "jitter", "0 s", "0.002 s")),
        ("network.phase_us.left_hip=5000", ("network", "left_hip", "0 s", "0.002 s", "0.005")),
        ("network.phase_us.left_ankle=5", ("network phase", "left_ankle", "left_hip")),
        ("network.phase_us.left_foot=5", ("network.phase_us.left_foot",)),
        ("network.clock_drift_ppm.left_hip=20000", ("network.clock_drift_ppm.left_hip", "-10000", "20000")),
        ("network.board_timeout_ms=0", ("network.board_timeout_ms", "0")),
        ("network.impedance=cpu", ("network.impedance", "board", "ccu", "cpu")),
        ("network.dbc=none.dbc", ("none.dbc",)),
        ("network.outages=['boot:ccu@3s']", ("network.outages[0]", "boot:ccu@3s")),
        ("network.outages=['silence@30s']", ("silence@30.0s", "20 s")),
        ("network={jitter_us: 5, jitter_s: 0.1}", ("jitter_us", "jitter_s")),
    ],
)
def test_mistakes_are_refused_in_one_line_with_a_suggestion(setting: str, facts: tuple[str, ...]) -> None:
    with pytest.raises(TwinGaitError) as caught:
        load_experiment("treadmill_guided", [setting])
    assert states(str(caught.value), *facts)
    assert len(str(caught.value).splitlines()) == 1


def test_a_bench_has_no_boards_of_the_other_leg() -> None:
    assert network_of("network=can", preset="bench_leg") == NetworkParameters()
    for setting in ("network.phase_us.left_hip=5", "network.outages=['reboot:left_hip@1s']"):
        with raises(ParameterFileError, "right_hip", "right_knee"):
            load_experiment("bench_leg", [setting])


def test_durations_of_the_kinds() -> None:
    with raises(ParameterError, "duration", "reboot", "0", "nan"):
        Outage(kind=OutageKind.REBOOT, time=1.0, node="ccu", duration=math.nan)
