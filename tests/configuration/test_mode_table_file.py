"""Tables of operating modes as files: what ships, mistakes at their keys, and the modes of an experiment."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml
from errors import raises, states

from twin_gait import load_experiment
from twin_gait.cli import main
from twin_gait.configuration.documents import dump_yaml, experiment_document, table_document
from twin_gait.configuration.gait_table_file import (
    load_gait_table,
    load_mode_table,
    load_state_table,
    mode_table_from_mapping,
    named_file,
    packaged_mode_tables,
)
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.gait.modes import ModeTable, TimedRequest

TABLE = Path(__file__).parents[1] / "tables" / "treadmill_modes.yaml"
WITH_POSTURES = f"table={TABLE}", "initial_mode=standing"
SMALL: dict[str, Any] = {
    "schema_version": 2,
    "requests": ["walk", "stop"],
    "hold": "held",
    "modes": {"rest": {}, "walk": {"walk": True, "step": True, "minimum_duration_ms": 20}, "held": {}},
    "transitions": [
        {"from": "rest", "to": "walk", "cause": "asked", "all": ["request in [walk]"]},
        {
            "from": "walk",
            "to": "rest",
            "cause": "asked",
            "any": ["request in [stop]", "trunk.pitch_deg > 30"],
        },
    ],
}


def read(data: dict[str, Any]) -> ModeTable:
    return mode_table_from_mapping(data, "my_modes.yaml", "my_modes")


@pytest.mark.parametrize("name", packaged_mode_tables())
def test_shipped_mode_tables_are_read_and_written_back(name):
    table = load_mode_table(name)
    assert table.name == name and table == read(yaml.safe_load(dump_yaml(table_document(table))))
    assert load_mode_table(named_file(name, "modes")) == table == load_state_table(name)


def test_the_table_of_quintero_has_the_transitions_of_the_paper():
    """Table II of PMC3375739, states S1 to S12 in the order of the comments of the file."""
    text = named_file("quintero_2011", "modes").read_text(encoding="utf-8")
    numbers = dict(line.split("# S")[::-1] for line in text.splitlines() if "{}  # S" in line)
    state = {name.split(":")[0].strip(): int(number) for number, name in numbers.items()}
    assert sorted(state.values()) == list(range(1, 13))
    found = [
        (state[item.source], state[item.target]) for item in load_mode_table("quintero_2011").transitions
    ]
    paper = [(1, 5), (5, 2), (2, 7), (7, 3), (3, 8), (8, 4), (4, 9), (9, 3), (3, 10), (10, 2), (2, 6), (6, 1)]
    assert sorted(found) == sorted([*paper, (2, 11), (11, 4), (4, 12), (12, 2)])


def test_a_minimal_file_has_hip_and_knee_and_the_file_name(tmp_path):
    table = read(SMALL)
    assert table.joints == ("hip", "knee") and table.name == "my_modes"
    assert table.phases["walk"].walk and table.phases["walk"].step and not table.phases["rest"].walk
    assert table.phases["walk"].minimum_ticks == 20 and table.members == ("walk", "stop")
    path = tmp_path / "mine.yaml"
    path.write_text(dump_yaml(SMALL), encoding="utf-8")
    assert load_state_table(path).name == "mine" and load_state_table(str(path)) == load_mode_table(path)


def test_the_same_transition_twice_is_refused():
    first = SMALL["transitions"][0]
    with pytest.raises(ParameterFileError) as caught:
        read({**SMALL, "transitions": [*SMALL["transitions"], first]})
    location = f"my_modes.yaml: transitions[{len(SMALL['transitions'])}]"
    assert states(str(caught.value), location, "from", "to", "cause")


def test_either_kind_of_table_is_found_by_its_name():
    assert load_state_table("treadmill_guided") == load_gait_table("treadmill_guided")
    with raises(ParameterError, "flight"):
        load_state_table("flight")
    with raises(ParameterError, "treadmill_guided", "twin"):
        load_mode_table("treadmill_guided")


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("hold",), "flying", ("my_modes.yaml", "hold", "flying", "rest", "walk", "held")),
        (("modes", "rest", "postur"), "stand", ("modes.rest.postur", "posture")),
        (
            ("modes", "walk", "minimum_duration_ms"),
            -1,
            ("modes.walk.minimum_duration_ms", "0", "3600000", "-1"),
        ),
        (("modes", "walk", "walk"), "yes please", ("modes.walk.walk", "true", "false", "yes please")),
        (("requests",), ["walk", "walk"], ("requests", "walk")),
        (("transitions", 0, "all"), ["request in [run]"], ("transitions[0]", "run")),
        (("transitions", 0, "all"), ["hip.angle_deg > 5"], ("transitions[0]", "hip.angle_deg")),
        (("transitions", 0, "to"), "flying", ("transitions[0]", "flying")),
        (("transitions", 0, "debounce_ms"), 5, ("transitions[0]", "request", "5 ms", "debounce_ms")),
        (("phases",), {}, ("phases", "modes")),
        (("schema_version",), 1, ("schema_version",)),
    ],
)
def test_mistakes_are_named_with_file_and_key(keys, value, message):
    data = copy.deepcopy(SMALL)
    inner: Any = data
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    with raises(ParameterFileError, *message) as caught:
        read(data)
    assert str(caught.value).startswith("my_modes.yaml") and "\n" not in str(caught.value)


# ------------------------------------------------------------------ of an experiment


def test_document_without_modes_has_no_key_for_modes():
    document = experiment_document(load_experiment("treadmill_guided").experiment)
    assert not {"modes", "requests", "initial_mode"} & set(document)


def test_modes_of_an_experiment_are_written_and_read_back(tmp_path):
    loaded = load_experiment("treadmill_start_stop", [*WITH_POSTURES, "modes=twin", "requests=[walk@2s]"])
    assert loaded.experiment.modes == load_mode_table("twin")
    assert loaded.experiment.requests == (TimedRequest("walk", 2000),)
    for number, document in enumerate((loaded.document, experiment_document(loaded.experiment))):
        path = tmp_path / f"again_{number}.yaml"
        path.write_text(dump_yaml(document), encoding="utf-8")
        assert load_experiment(path).experiment == loaded.experiment


def test_modes_may_be_in_the_experiment_file_or_in_a_separate_file(tmp_path):
    (tmp_path / "mine.yaml").write_text(dump_yaml(SMALL), encoding="utf-8")
    for number, modes in enumerate(("mine.yaml", SMALL)):
        path = tmp_path / f"experiment_{number}.yaml"
        data = {"preset": "treadmill_start_stop", "modes": modes}
        path.write_text(dump_yaml(data), encoding="utf-8")
        found = load_experiment(path).experiment.modes
        assert found is not None and found.phases == read(SMALL).phases
    (tmp_path / "mine.yaml").write_text(dump_yaml({**SMALL, "hold": "x"}), encoding="utf-8")
    with raises(ParameterFileError, "mine.yaml", "hold", "x"):
        load_experiment(tmp_path / "experiment_0.yaml")


def test_modes_without_their_joints_are_refused():
    with raises(ParameterFileError, "joints", "twin", "hip, knee", "ankle"):
        load_experiment(
            "treadmill_start_stop", [*WITH_POSTURES, "modes=twin", "modes.joints=[hip, knee, ankle]"]
        )


@pytest.mark.parametrize("kind", ["svg", "mermaid", "transitions", "truth"])
def test_the_commands_take_a_table_of_modes(kind, capsys):
    assert main(["diagram", "twin", "--format", kind]) == 0
    drawn = capsys.readouterr().out
    assert "stopping" in drawn and ("request" in drawn.lower())


def test_settings_replace_modes_and_their_requests_together():
    """The schedule of the preset has requests that the other modes lack."""
    experiment = load_experiment("day", ["modes=rewalk", "requests=[sit_to_stand@0.5s]"]).experiment
    assert experiment.modes == load_mode_table("rewalk")
    assert experiment.requests == (TimedRequest("sit_to_stand", 500),)
    with raises(ParameterFileError, "walk_automatic@14s", "sit_to_stand, walk, stand, stand_to_sit"):
        load_experiment("day", ["modes=rewalk"])


def test_shipped_mode_tables_have_no_error_and_those_to_walk_in_have_no_warning(capsys):
    for name in packaged_mode_tables():
        assert main(["check", name]) == 0
        last = capsys.readouterr().out.splitlines()[-1]
        assert last.startswith(f"{name}, by itself: 0 errors")
        assert name == "quintero_2011" or "0 warnings" in last
    assert main(["presets", "twin"]) == 0 and "hold: hold" in capsys.readouterr().out
