"""Events of an experiment file: read, written, and refused in one line."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from errors import states

from twin_gait import load_experiment
from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.events import changeable_keys
from twin_gait.configuration.experiments import LoadedExperiment
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.events import Change, Push, Step, Stop

PHASES = "table.phases.middle_stance"
KNEE = f"{PHASES}.knee"
PATH = "experiment.table.phases.middle_stance.joints.knee"


def load(events: str, *more: str, preset: str = "treadmill_guided") -> LoadedExperiment:
    return load_experiment(preset, [f"events={events}", *more])


def test_events_are_read_in_si_in_the_order_of_time():
    events = load(
        "[{time_s: 9.2, stop: true}, {time_s: 8, push: {joint: left_knee, torque_Nm: 20, duration_ms: 200}},"
        f" {{time_s: 5.0, set: {{{KNEE}.stiffness_Nm_per_deg: 3.2, monitor.control: torque_control}}}},"
        " {time_s: 6, step: true, by: Ann},"
        " {time_s: 7, set: {table: {sides: {left: {swing_flexion: {gravity_compensation: 0.5}}}},"
        " scenario: {belt_speed_km_per_h: 1.2}}, fade_ms: 0}]"
    ).experiment.events
    side = "experiment.table.side_phases.left.swing_flexion.gravity_compensation"
    assert [replace(item, changes={}) if isinstance(item, Change) else item for item in events] == [
        Change(tick=5000),
        Step(tick=6000, by="Ann"),
        Change(tick=7000, fade_ticks=0),
        Push(tick=8000, joint="left_knee", torque=20.0, duration_ticks=200),
        Stop(tick=9200),
    ]
    assert list(events[0].changes) == [f"{PATH}.stiffness", "mode"]
    assert events[0].changes[f"{PATH}.stiffness"] == pytest.approx(3.2 * 180.0 / math.pi, rel=1e-15)
    assert events[0].changes["mode"] == "torque_control"
    assert events[2].changes == pytest.approx({side: 0.5, "experiment.scenario.belt_speed": 1.2 / 3.6})


def test_faults_and_requests_among_events_equal_those_of_the_experiment_and_appear_once():
    loaded = load(
        "[{time_s: 1.5, request: walk}, {time_s: 2, fault: 'encoder_drift:right_hip=20deg/s'}]",
        "modes=walking",
        "faults=['supply_dip@3s']",
        preset="overground",
    )
    experiment = loaded.experiment
    assert str(experiment.faults[0]) == "supply_dip@3.0s" and len(experiment.faults) == 2
    assert (experiment.faults[1].time, experiment.faults[1].location) == (2.0, "right_hip")
    assert "walk@1.5s" in map(str, experiment.requests) and experiment.events == ()
    assert loaded.document["faults"] == ["supply_dip@3s"]


def test_written_events_are_read_back_equal():
    events = f"[{{time_s: 0, set: {{{KNEE}.equilibrium_deg: 17.3}}, by: Ann}}, {{time_s: 0.7, step: true}}]"
    experiment = load(events).experiment
    document = experiment_document(experiment)
    assert document["events"][1] == {"time_s": 0.7, "step": True}
    again = load_experiment("treadmill_guided", [f"events={document['events']}"]).experiment
    assert again.events == experiment.events


def test_every_changeable_key_is_accepted_by_set():
    plain = load_experiment("treadmill_guided").experiment
    for key, target in changeable_keys(plain).items():
        if target.item is None or key.startswith(("monitor", "table.sides")):
            continue
        value = target.item.range.maximum / target.factor if target.item.range.maximum < 1e4 else 0.5
        direct = load_experiment("treadmill_guided", [f"{key}={value!r}"]) if "belt" not in key else None
        (event,) = load(f"[{{time_s: 1, set: {{{key}: {value!r}}}}}]").experiment.events
        if direct is not None:
            record = direct.experiment
            for step in target.path.split(".")[1:]:
                record = record[step] if isinstance(record, dict) else getattr(record, step)
            assert event.changes == {target.path: record}


@pytest.mark.parametrize(
    ("events", "facts"),
    [
        ("[{time_s: 1}]", ("events[0]", "set", "push", "step", "stop", "request", "fault")),
        ("[{AT stop: true, step: true}]", ("events[0]", "stop", "step")),
        ("[{stop: true}]", ("events[0].time_s",)),
        ("[{time_s: -1, stop: true}]", ("events[0].time_s", "0", "-1")),
        ("[{time_s: 99, stop: true}]", ("events", "20 s", "99.0")),
        ("[{AT stop: false}]", ("events[0].stop", "False")),
        ("[{AT halt: true}]", ("events[0].halt",)),
        ("[{AT step: true, fade_ms: 3}]", ("events[0]", "fade_ms", "set")),
        ("[{AT push: {joint: toe, torque_Nm: 1, duration_ms: 9}}]", ("joint", "push", "toe")),
        ("[{AT push: {joint: left_hip, torque_Nm: 2e3, duration_ms: 9}}]", ("events[0].push.torque_Nm",)),
        ("[{AT push: {joint: left_hip, torque_Nm: 1, duration_ms: 0}}]", ("events[0].push.duration_ms",)),
        ("[{AT set: {patient.mass_kg: 80}}]", ("events[0].set", "patient.mass_kg")),
        (f"[{{AT set: {{{KNEE}.stifness_Nm_per_deg: 3}}}}]", (f"{KNEE}.stiffness_Nm_per_deg",)),
        (f"[{{AT set: {{{KNEE}.stiffness_Nm_per_deg: -3}}}}]", (f"{KNEE}.stiffness_Nm_per_deg", "0", "-3")),
        (f"[{{AT set: {{{KNEE}.stiffness_Nm_per_deg: soft}}}}]", (f"{KNEE}.stiffness_Nm_per_deg", "soft")),
        (
            f"[{{AT set: {{{KNEE}.damping_ratio: 1, {PHASES}: {{knee: {{damping_Nms_per_rad: 1}}}}}}}}]",
            ("events[0].set", "damping_ratio", "damping_Nms_per_rad"),
        ),
        ("[{AT set: {monitor.control: fly}}]", ("monitor.control", "walk", "friction_control", "fly")),
        ("[{AT set: {monitor.steps_by_hand: 1}}]", ("monitor.steps_by_hand", "false", "true", "1")),
        ("[{AT request: walk}]", ("walk@1s", "modes", "twin")),
        ("[{AT fault: 'motor_dead@2s:left_hip'}]", ("events[0]", "motor_dead@2s:left_hip@1.0s")),
    ],
)  # fmt: skip
def test_mistakes_are_one_line_with_file_key_and_value(events: str, facts: tuple[str, ...]):
    with pytest.raises(ParameterFileError) as caught:
        load(events.replace("AT", "time_s: 1,"))
    text = str(caught.value)
    assert states(text, "treadmill_guided", "--set", *facts) and "\n" not in text
