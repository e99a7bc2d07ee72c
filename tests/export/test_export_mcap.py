"""MCAP of a log: the library of MCAP reads the same values."""

from __future__ import annotations

import sys

import numpy as np
import pandas as pd
import pytest
from errors import raises, states

from twin_gait import load_experiment, simulate
from twin_gait.cli import main
from twin_gait.exceptions import MissingOptionalDependency
from twin_gait.export.mcap import export_mcap, log_channels
from twin_gait.runs.record import save_run

mcap_reader = pytest.importorskip("mcap.reader", reason="needs mcap: pip install 'twin-gait[mcap]'")
mcap_protobuf = pytest.importorskip("mcap_protobuf.decoder", reason="needs mcap-protobuf-support")


def read_mcap(path) -> tuple[pd.DataFrame, dict[str, set[str]]]:
    """Return the columns of a file, and the encodings of its channels and schemas."""
    rows: dict[int, dict[str, object]] = {}
    encodings: dict[str, set[str]] = {}
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file, decoder_factories=[mcap_protobuf.DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            encodings[channel.topic] = {channel.message_encoding, schema.encoding}
            prefix = "" if channel.topic == "/walk" else f"{channel.topic[1:]}_"
            names = [field.name for field in decoded.DESCRIPTOR.fields]
            rows.setdefault(message.log_time, {}).update(
                {prefix + name: getattr(decoded, name) for name in names}
            )
    return pd.DataFrame.from_dict(rows, orient="index"), encodings


@pytest.mark.parametrize(
    "settings", [["duration_s=0.3"], ["duration_s=0.05", "interface=brace", "network=can"]]
)
def test_the_file_is_the_log_bit_for_bit(tmp_path, settings):
    log = simulate(load_experiment("treadmill_guided", [*settings, "engine=pinocchio"]).experiment).log
    export_mcap(log, tmp_path / "log.mcap")
    found, encodings = read_mcap(tmp_path / "log.mcap")
    assert set(found) == set(log) and len(found) == len(log) and len(log) >= 50
    np.testing.assert_array_equal(found.index, 1_000_000 * np.arange(len(log)))
    for name in log:
        given, kind = log[name].to_numpy(), found[name].map(type).unique()
        assert len(kind) == 1
        if kind[0] is float:
            np.testing.assert_array_equal(found[name].to_numpy(), given.astype(float), err_msg=name)
        else:
            assert found[name].tolist() == given.tolist(), name
    assert {"/left_hip", "/right_knee", "/left_foot", "/walk"} <= encodings.keys()
    assert all(encoding == {"protobuf"} for encoding in encodings.values())


def test_columns_are_grouped_by_the_part_of_the_device():
    names = [
        "time_s",
        "left_phase",
        "left_hip_angle_rad",
        "left_hip_wearer_angle_rad",
        "right_foot_clearance_m",
    ]
    assert log_channels(names) == {
        "walk": {"time_s": "time_s"},
        "left": {"phase": "left_phase"},
        "left_hip": {"angle_rad": "left_hip_angle_rad", "wearer_angle_rad": "left_hip_wearer_angle_rad"},
        "right_foot": {"clearance_m": "right_foot_clearance_m"},
    }


def test_a_run_is_exported_from_the_terminal(tmp_path, capsys, monkeypatch):
    settings = ["duration_s=0.05", "engine=pinocchio"]
    folder = save_run(
        simulate(load_experiment("treadmill_guided", settings).experiment), tmp_path / "run", pictures=False
    )
    assert main(["export", str(folder), "--format", "mcap"]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "log.mcap")
    found, _ = read_mcap(folder / "log.mcap")
    assert len(found) == 50
    assert main(["export", str(folder), "--format", "mcap"]) == 2
    assert main(["export", str(folder), "--format", "mcap", "--out", str(tmp_path / "log.csv")]) == 2
    assert states(capsys.readouterr().err, "--force", ".mcap", ".csv")
    assert main(["export", str(folder), "--format", "mcap", "--convention", "rajagopal"]) == 2
    monkeypatch.setitem(sys.modules, "mcap_protobuf.writer", None)
    with raises(MissingOptionalDependency, "mcap-protobuf-support", "twin-gait[mcap]"):
        export_mcap(pd.DataFrame({"time_s": [0.0]}), tmp_path / "log.mcap")
