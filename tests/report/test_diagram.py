"""Drawings and tables of gait tables, and the command that writes them.

The truth table is read back from its Markdown and held against the state machine on random
measurements; conditions are judged by :mod:`guard_solver`, which shares no code with the evaluator.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pytest
from errors import raises
from guard_solver import OWN_TIME, Measurements, holds
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from table_builder import JOINTS, guard, impedance, phase, transition, two_phase_table

from twin_gait.cli import tables as command
from twin_gait.configuration.gait_table_file import load_gait_table, packaged_gait_tables
from twin_gait.exceptions import TwinGaitError
from twin_gait.gait.documents import Debounced, MinimumTime, PhaseLogic, transition_table, truth_table
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, parse_guard
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.signals import all_signal_names
from twin_gait.gait.table import TICK, Blending, GaitTable, Scaling
from twin_gait.report.state_diagram import (
    arrows,
    describe_guard,
    state_diagram_mermaid,
    state_diagram_svg,
)
from twin_gait.testing.cases import approval_text
from twin_gait.vocabulary import Side

SVG = "{http://www.w3.org/2000/svg}"


def nested_table() -> GaitTable:
    """Exits that share conditions, exclude each other, nest, debounce and wait."""
    near = guard("hip.angle_deg > 10")
    far = AllOf(guards=(guard("hip.angle_deg > 20"), guard("hip.angle_deg - other.hip.angle_deg > 4")))
    either = AnyOf(guards=(far, AllOf(guards=(near, guard("other.phase in [stance]")))))
    back = AnyOf(guards=(guard("hip.angle_deg < 5"), guard("other.hip.angle_deg - hip.angle_deg < -4")))
    exits = (
        transition("stance", "swing", AllOf(guards=(either,)), cause="either", debounce_ticks=3),
        transition("stance", "swing", near, cause="near_and_late", timeout_ticks=40),
        transition("stance", "swing", guard("other.phase in [swing]"), cause="other", debounce_ticks=9),
        transition("stance", "swing", None, cause="timeout", timeout_ticks=300),
        transition("swing", "stance", back, cause="back", debounce_ticks=2),
    )
    phases = {"stance": phase(minimum_ticks=20), "swing": phase()}
    return GaitTable(name="nested", joints=JOINTS, phases=phases, transitions=exits)


TABLES = {name: load_gait_table(name) for name in packaged_gait_tables()} | {"nested": nested_table()}
each_table = pytest.mark.parametrize("table", list(TABLES.values()), ids=list(TABLES))


def one_phase_table() -> GaitTable:
    return GaitTable(name="hold", joints=JOINTS, phases={"hold": phase()}, transitions=())


# -- truth table ----------------------------------------------------------------------------------


class PrintedPhase(NamedTuple):
    """A phase of a truth table as a reader of its Markdown sees it."""

    conditions: list[str]
    rows: list[list[str]]


def read_truth_table(text: str) -> dict[str, PrintedPhase]:
    """Read the Markdown back: legend and rows per phase."""
    found = {}
    for section in text.split("\n## ")[1:]:
        name, body = section.split("\n", 1)
        conditions = re.findall(r"^- [A-Z]+\d*: (.*)$", body, flags=re.MULTILINE)
        lines = [
            [cell.strip() for cell in line.strip("|").split("|")]
            for line in body.splitlines()
            if re.match(r"\| [TF–] ", line)
        ]
        found[name] = PrintedPhase(conditions, lines)
    return found


class Reader:
    """Follows one leg with the printed truth table only."""

    def __init__(self, table: GaitTable) -> None:
        self.table = table
        self.printed = read_truth_table(truth_table(table))
        self._atom = cache(lambda text: parse_guard(text.strip("`")))
        self.open_for: dict[str, int] = {}
        self.visited: set[tuple[str, int]] = set()

    def next_phase(self, source: str, found: Measurements) -> tuple[str, str]:
        """Next phase and cause by the one row that fits."""
        conditions, rows = self.printed[source]
        if not rows:
            return source, ""  # the phase is never left
        truth = ["T" if self._true(source, text, found) else "F" for text in conditions]
        fitting = [
            number
            for number, row in enumerate(rows)
            if all(mark in ("–", value) for mark, value in zip(row, truth, strict=False))
        ]
        assert len(fitting) == 1, (source, truth, fitting)
        self.visited.add((source, fitting[0]))
        target, cause = rows[fitting[0]][len(conditions) :]
        return (source, "") if target == "stays" else (target, cause)

    def _true(self, source: str, text: str, found: Measurements) -> bool:
        if text.startswith("`"):
            return holds(self._atom(text), found.signals, found.other_phase)
        stay = re.fullmatch(r"in the phase for ([\d.]+) s or longer", text)
        if stay:
            return found.tick >= round(float(stay.group(1)) / TICK)
        cause, target, ticks = re.fullmatch(r"guard of (\S+) to (\S+) true for (\d+) ms .*", text).groups()
        (item,) = (
            entry
            for entry in self.table.transitions
            if (entry.source, entry.target, entry.cause) == (source, target, cause)
        )
        self.open_for[text] = self.open_for.get(text, 0) + 1 if holds(item.guard, *found_parts(found)) else 0
        return self.open_for[text] >= int(ticks)


def found_parts(found: Measurements) -> tuple[Any, str | None]:
    return found.signals, found.other_phase


def comparisons_of(item: Guard) -> list[Comparison]:
    if isinstance(item, (AllOf, AnyOf)):
        return [found for inner in item.guards for found in comparisons_of(inner)]
    return [item] if isinstance(item, Comparison) else []


def thresholds_of(table: GaitTable) -> dict[str, list[float]]:
    """What each signal is compared with."""
    atoms = [atom for entry in table.transitions for atom in comparisons_of(entry.guard)]
    names = all_signal_names(table.joints)
    return {name: [atom.threshold for atom in atoms if name in (atom.signal, atom.minus)] for name in names}


def value_near_threshold(near: list[float], rng: np.random.Generator) -> float:
    """A value of a signal, mostly close to a threshold it is compared with."""
    if near and rng.random() < 0.9:
        # No difference of two of these is a threshold, where degrees and radians round to either side.
        return float(rng.choice(near) + rng.choice([-1.0, 1.0]) * rng.choice([0.0123, 0.117, 2.91, 31.3]))
    return float(rng.uniform(-40.0, 80.0))


# In these a rare transition takes a hundred thousand steps to be met with.
LONG = ("overground", "treadmill_start_stop")


@pytest.mark.parametrize(
    "table",
    [
        pytest.param(table, id=name, marks=[pytest.mark.slow] if name in LONG else [])
        for name, table in TABLES.items()
    ],
)
def test_state_machine_follows_the_printed_truth_table(table: GaitTable) -> None:
    rng = np.random.default_rng(5)
    reader = Reader(table)
    machine = GaitStateMachine(table, Side.LEFT)
    thresholds = thresholds_of(table)
    signals = {name: value_near_threshold(near, rng) for name, near in thresholds.items()}
    tick, taken, other = 1, set(), table.phase_names[0]
    every = set(range(len(table.transitions)))
    for step in range(200_000):
        if step >= 5000 and taken == every:
            break
        if table.postures and step % 200 == 0:  # a mode may send the leg into any of them
            machine = GaitStateMachine(table, Side.LEFT, initial_phase=str(rng.choice(table.phase_names)))
            machine.entry_tick, reader.open_for = tick, {}
        change = 0.03 if step < 5000 else 0.2  # what is still missing wants many signals in a rare place
        for name, near in thresholds.items():
            if rng.random() < change:
                signals[name] = value_near_threshold(near, rng)
        if rng.random() < change:
            other = str(rng.choice(table.phase_names))
        signals[OWN_TIME] = (tick - machine.entry_tick) * TICK
        found = Measurements(dict(signals), other)
        source = machine.phase
        expected = reader.next_phase(source, found)
        switch = machine.step(tick, signals, other)
        assert (machine.phase, "" if switch is None else switch.cause) == expected
        if switch is not None:
            taken.add(switch.transition)
            reader.open_for = {}
        tick += 1 if rng.random() < 0.98 else 6000 if rng.random() < 0.05 else 400
    # Sitting down waits for 300 ms without a break, or for eight seconds: rare where signals change so often.
    assert taken == every or (table.postures and len(taken) > 0.9 * len(every))
    assert len(reader.visited) > 0.6 * sum(len(item.rows) for item in reader.printed.values())


def independent_outcome(table: GaitTable, logic: PhaseLogic, truth: dict[Any, bool]) -> int | None:
    """First exit that is due, by recursion over the guard's tree on truths."""

    def true(item: Guard) -> bool:
        if isinstance(item, AllOf):
            return all(true(inner) for inner in item.guards)
        if isinstance(item, AnyOf):
            return any(true(inner) for inner in item.guards)
        return truth[item]

    minimum = table.phases[logic.phase].minimum_ticks
    for index, item in enumerate(table.transitions):
        waits = [Debounced(index, item.debounce_ticks)] if item.debounce_ticks > 1 else []
        waits += [] if item.timeout_ticks is None else [MinimumTime(item.timeout_ticks)]
        waits += [MinimumTime(minimum)] if minimum else []
        if item.source == logic.phase and true(item.guard) and all(truth[wait] for wait in waits):
            return index
    return None


@each_table
def test_every_possible_combination_is_in_exactly_one_row(table: GaitTable) -> None:
    """Brute force over all combinations of truth."""
    for name in table.phase_names:
        logic = PhaseLogic(table, name)
        rows = logic.rows()
        for truth in itertools.product((True, False), repeat=len(logic.conditions)):
            known = dict(zip(logic.conditions, truth, strict=True))
            fitting = [row for row in rows if row.truths.items() <= known.items()]
            if not logic.possible(known):
                continue
            assert len(fitting) == 1
            outcome = independent_outcome(table, logic, known)
            assert fitting[0].transition == outcome
            assert logic.first_possible_exit(known) == (outcome, True)


def test_conditions_that_exclude_each_other_need_no_rows() -> None:
    """Beyond 20° is beyond 10° too, and the other leg is not in two phases at once."""
    table = nested_table()
    logic = PhaseLogic(table, "stance")
    conditions = {str(item): item for item in logic.conditions}
    near, far = conditions["hip.angle_deg > 10"], conditions["hip.angle_deg > 20"]
    assert not logic.possible({far: True, near: False})
    assert logic.possible({far: False, near: True})
    both = {conditions["other.phase in [stance]"]: True, conditions["other.phase in [swing]"]: True}
    assert not logic.possible(both)
    assert logic.possible(dict.fromkeys(both, False))  # a leg alone is in neither
    late, later = MinimumTime(40), MinimumTime(300)
    assert {late, later} <= set(logic.conditions)
    assert not logic.possible({later: True, late: False})


def test_differences_are_recognised_in_either_order() -> None:
    forth = guard("hip.angle_deg - other.hip.angle_deg > 4")
    back = guard("other.hip.angle_deg - hip.angle_deg > -4")
    logic = PhaseLogic(two_phase_table(transition("stance", "swing", AnyOf(guards=(forth, back)))), "stance")
    assert not logic.possible({forth: True, back: True})
    assert logic.possible({forth: False, back: False})  # on the very threshold
    assert logic.possible({forth: True, back: False})


def test_difference_is_held_against_its_two_signals() -> None:
    """Below 3° and the other leg above 2° the difference cannot be beyond 4°."""
    own, other = guard("hip.angle_deg < 3"), guard("other.hip.angle_deg > 2")
    far = guard("hip.angle_deg - other.hip.angle_deg > 4")
    table = two_phase_table(transition("stance", "swing", AnyOf(guards=(far, AllOf(guards=(own, other))))))
    logic = PhaseLogic(table, "stance")
    assert not logic.possible({own: True, other: True, far: True})
    assert logic.possible({own: True, other: False, far: True})


def test_a_time_equal_to_its_threshold_is_possible() -> None:
    """After 50 ticks a timeout of 0.05 s is over and "longer than 0.05 s" is not yet true."""
    longer, shorter = guard("time_in_phase_s > 0.05"), guard("time_in_phase_s < 0.05")
    exits = (
        transition("stance", "swing", AnyOf(guards=(longer, shorter)), cause="early"),
        transition("stance", "swing", None, cause="timeout", timeout_ticks=50),
    )
    logic = PhaseLogic(two_phase_table(*exits), "stance")
    assert logic.conditions == (longer, shorter, MinimumTime(50))
    assert logic.possible({longer: False, shorter: False, MinimumTime(50): True})
    assert not logic.possible({longer: False, shorter: False, MinimumTime(50): False})
    assert not logic.possible({longer: True, MinimumTime(50): False})
    assert not logic.possible({shorter: True, MinimumTime(50): True})


def test_phase_with_very_many_conditions_has_no_table() -> None:
    atoms = tuple(guard(f"hip.velocity_deg_per_s - other.hip.velocity_deg_per_s > {k}") for k in range(13))
    table = two_phase_table(
        transition("stance", "swing", AnyOf(guards=(AllOf(guards=atoms[:7]), atoms[7])), cause="some"),
        transition("stance", "swing", AllOf(guards=atoms[8:]), cause="rest", debounce_ticks=4),
    )
    assert "- M: `hip.velocity_deg_per_s - other.hip.velocity_deg_per_s > 12`" in truth_table(table)
    assert "Too many combinations for a table" in truth_table(table)


def test_phase_that_is_never_left_is_marked() -> None:
    assert "never left" in truth_table(one_phase_table())


@each_table
def test_tables_are_the_same_text_every_time(table: GaitTable) -> None:
    again = dataclasses.replace(table, description="another description")
    assert truth_table(table) == truth_table(again)
    assert transition_table(table) == transition_table(again)


def edited(change: Callable[[GaitTable], GaitTable]) -> tuple[str, str]:
    table = nested_table()
    return approval_text(table), approval_text(change(table))


def with_transition(index: int, **changes: Any) -> Callable[[GaitTable], GaitTable]:
    def change(table: GaitTable) -> GaitTable:
        items = list(table.transitions)
        items[index] = dataclasses.replace(items[index], **changes)
        return dataclasses.replace(table, transitions=tuple(items))

    return change


def with_phase(**changes: Any) -> Callable[[GaitTable], GaitTable]:
    return lambda table: dataclasses.replace(table, phases={**table.phases, "swing": phase(**changes)})


def with_joint(**changes: Any) -> Callable[[GaitTable], GaitTable]:
    return with_phase(joints={"hip": impedance(), "knee": impedance(**changes)})


def swapped(table: GaitTable) -> GaitTable:
    first, second, *rest = table.transitions
    return dataclasses.replace(table, transitions=(second, first, *rest))


EDITS: dict[str, Callable[[GaitTable], GaitTable]] = {
    "threshold": with_transition(4, guard=guard("hip.angle_deg < 5.001")),
    "debounce": with_transition(0, debounce_ticks=4),
    "timeout": with_transition(3, timeout_ticks=301),
    "cause": with_transition(2, cause="contralateral"),
    "order": swapped,
    "stiffness": with_joint(stiffness=100.001),
    "damping": with_joint(damping=20.001),
    "damping ratio": with_joint(damping=None, damping_ratio=0.7),
    "equilibrium": with_joint(equilibrium_angle=0.2001),
    "gain": with_joint(friction_compensation_gain=0.351),
    "gravity share": with_phase(gravity_compensation=0.01),
    "minimum duration": with_phase(minimum_ticks=1),
    "blending": lambda table: dataclasses.replace(table, blending=Blending(duration_ticks=61)),
    "one side": lambda table: dataclasses.replace(table, side_phases={Side.LEFT: {"swing": phase()}}),
    "carried mass": lambda table: dataclasses.replace(table, scaling=Scaling(carried_mass=36.5)),
    "speed": lambda table: dataclasses.replace(table, scaling=Scaling(speed=0.4, speed_exponent=0.1)),
}


@pytest.mark.parametrize("change", list(EDITS.values()), ids=list(EDITS))
def test_any_edit_of_a_table_shows_in_the_approved_text(change: Callable[[GaitTable], GaitTable]) -> None:
    before, after = edited(change)
    assert before != after


@each_table
def test_transition_table_has_a_row_for_each_transition(table: GaitTable) -> None:
    rows = transition_table(table).splitlines()[6:]
    assert len(rows) == len(table.transitions)
    for item in table.transitions:
        (row,) = (
            line
            for line in rows
            if all(f" {word} " in line for word in (item.source, item.target, item.cause))
        )
        assert item.is_timeout or f"`{item.guard}`" in row
        if item.timeout_ticks is not None:
            assert f" {item.timeout_ticks * TICK:g} " in row


def test_names_of_a_table_are_escaped_in_markdown() -> None:
    odd = two_phase_table(transition("stance", "swing", "hip.angle_deg > 1", cause="a | b\n<b>"))
    for text in (truth_table(odd), transition_table(odd)):
        assert "a \\| b &lt;b>" in text
        assert "<b>" not in text


# -- drawing --------------------------------------------------------------------------------------


def texts(svg: str) -> list[str]:
    return ["".join(item.itertext()) for item in ElementTree.fromstring(svg).iter(f"{SVG}text")]


@each_table
def test_drawing_shows_phases_causes_thresholds_and_parameters(table: GaitTable) -> None:
    shown = " ".join(" ".join(texts(state_diagram_svg(table))).split())
    for name, parameters in table.phases.items():
        assert name.replace("_", " ") in shown
        for joint in parameters.joints.values():
            assert f"{math.degrees(joint.equilibrium_angle):.4g}°".replace("-", "−") in shown
            assert f"{math.radians(joint.stiffness):.4g}" in shown
    for item in table.transitions:
        assert item.cause.replace("_", " ") in shown
        for atom in comparisons_of(item.guard):
            assert f"{atom.operator} {atom.threshold:g}".replace("-", "−") in shown


@each_table
def test_drawing_has_an_arrow_for_each_way_and_dashes_timeouts(table: GaitTable) -> None:
    root = ElementTree.fromstring(state_diagram_svg(table))
    drawn = [item.get("class") for item in root.iter(f"{SVG}path") if "arrow" in (item.get("class") or "")]
    guarded = {(item.source, item.target) for item in table.transitions if not item.is_timeout}
    timed = {(item.source, item.target) for item in table.transitions if item.is_timeout}
    assert drawn.count("arrow") == len(guarded)
    assert drawn.count("arrow timeout") == len(timed)


@each_table
def test_all_elements_are_inside_the_drawing(table: GaitTable) -> None:
    root = ElementTree.fromstring(state_diagram_svg(table))
    left, top, width, height = (float(part) for part in root.attrib["viewBox"].split())
    for item in root.iter(f"{SVG}text"):
        assert left <= float(item.attrib["x"]) <= left + width
        assert top <= float(item.attrib["y"]) <= top + height


class Rectangle(NamedTuple):
    """A rectangle by its centre and sizes."""

    x: float
    y: float
    width: float
    height: float


class Drawn(NamedTuple):
    """What a reader of a drawing sees: boxes, texts with where they are, and points along the arrows."""

    boxes: list[Rectangle]
    texts: list[tuple[str, Rectangle]]
    arrows: np.ndarray


_WIDTHS = {
    "name": (15.0, "semibold"),
    "title": (17.0, "semibold"),
    "cause": (13.0, "semibold"),
    "faint": (12.0, "normal"),
}


@cache
def width_of(content: str, size: float, weight: str) -> float:
    font = FontProperties(family="DejaVu Sans", size=size, weight=weight)
    return TextPath((0.0, 0.0), content, prop=font).get_extents().width


def drawn(table: GaitTable) -> Drawn:
    """Read a drawing back; letters are as wide as in DejaVu Sans, the widest of its fonts."""
    root = ElementTree.fromstring(state_diagram_svg(table))
    boxes, texts, points = [], [], []
    for item in root.iter(f"{SVG}rect"):
        x, y, width, height = (float(item.get(key)) for key in ("x", "y", "width", "height"))
        if item.get("class") == "box":
            boxes.append(Rectangle(x + width / 2.0, y + height / 2.0, width, height))
    for item in root.iter(f"{SVG}text"):
        content = "".join(item.itertext())
        size, weight = _WIDTHS.get(item.get("class", ""), (13.0, "normal"))
        width = width_of(content, size, weight) if content else 0.0
        x, y = float(item.get("x")), float(item.get("y"))
        x -= {"middle": width / 2.0, "end": width}.get(item.get("text-anchor", ""), 0.0)
        if content:
            texts.append((content, Rectangle(x + width / 2.0, y - 0.3 * size, width, 0.8 * size)))
    for item in root.iter(f"{SVG}path"):
        if "arrow" in item.get("class", ""):
            x, start, lane, end, tip = map(float, re.findall(r"-?[\d.]+", item.get("d")))
            corners = np.array([(x, start), (lane, start), (lane, end), (tip, end)])
            share = np.linspace(0.0, 1.0, 200)[:, None]
            points += [a + share * (b - a) for a, b in itertools.pairwise(corners)]
    return Drawn(boxes, texts, np.concatenate(points))


@each_table
def test_elements_of_a_drawing_do_not_overlap(table: GaitTable) -> None:
    found = drawn(table)
    assert len(found.boxes) == len(table.phases)
    assert not any(overlap(a, b) for a, b in itertools.combinations(found.boxes, 2))
    for (first, a), (second, b) in itertools.combinations(found.texts, 2):
        assert not overlap(a, b), f"{first!r} on {second!r}"
    for text, extent in found.texts:
        half = np.array([extent.width, extent.height]) / 2.0
        crossed = (np.abs(found.arrows - [extent.x, extent.y]) < half).all(axis=1)
        badge = text.replace(", ", "").isdigit()  # it lies on its arrow
        assert badge or not crossed.any(), f"an arrow through {text!r}"
        for box in found.boxes:
            inside = (
                abs(extent.x - box.x) + half[0] <= box.width / 2.0
                and abs(extent.y - box.y) < box.height / 2.0
            )
            assert inside or not overlap(extent, box), f"{text!r} on a box"


def overlap(a: Rectangle, b: Rectangle) -> bool:
    return abs(a.x - b.x) < (a.width + b.width) / 2 and abs(a.y - b.y) < (a.height + b.height) / 2


@each_table
def test_different_arrows_do_not_overlap(table: GaitTable) -> None:
    laid = arrows(table, 100.0)
    assert len({level for arrow in laid for level in (arrow.start, arrow.end)}) == 2 * len(laid)
    for one, other in itertools.combinations(laid, 2):
        (low, high), (least, most) = sorted((one.start, one.end)), sorted((other.start, other.end))
        assert one.lane != other.lane or high < least or most < low


def test_names_of_a_table_are_escaped_in_the_drawing() -> None:
    odd = one_phase_table()
    odd = dataclasses.replace(odd, name='<script>"&', phases={"a<b & c": phase()})
    shown = texts(state_diagram_svg(odd))
    assert '<script>"&' in shown
    assert "1 a<b & c" in shown


def test_mermaid_has_every_transition_and_no_character_that_it_reads_as_syntax() -> None:
    for table in TABLES.values():
        head, *lines = state_diagram_mermaid(table).splitlines()
        assert head == "stateDiagram-v2"
        labelled = [line.split(": ", 1) for line in lines if " --> " in line and ": " in line]
        assert len(labelled) == len(table.transitions)
        for (path, label), item in zip(labelled, table.transitions, strict=True):
            source, target = (part.strip() for part in path.split("-->"))
            names = (f"phase_{1 + table.phase_index(phase)}" for phase in (item.source, item.target))
            assert (source, target) == tuple(names)
            assert not set(re.sub(r"#\d+;", "", label)) & set(":;<>#\"'{}%|")


def test_every_signal_has_a_label_and_a_unit() -> None:
    texts = [
        "hip.angle_deg > 3",
        "other.knee.velocity_deg_per_s < 3",
        "foot.load_bw > 3",
        "time_in_phase_s > 3",
    ]
    texts += ["trunk.pitch_deg > 3", "walk > 0.5"]
    assert [describe_guard(parse_guard(text)) for text in texts] == [
        "hip > 3°",
        "other knee velocity < 3°/s",
        "foot load > 3 BW",
        "time in phase > 3 s",
        "trunk pitch > 3°",
        "walk command > 0.5",
    ]


def test_phases_named_like_mermaid_keywords_get_other_identifiers() -> None:
    odd = dataclasses.replace(one_phase_table(), phases={'end "it"': phase()})
    text = state_diagram_mermaid(odd)
    assert 'state "end #34;it#34;" as phase_1' in text
    assert "[*] --> phase_1" in text


# -- command --------------------------------------------------------------------------------------


def twin_gait_diagram(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_parser(parser.add_subparsers())
    parsed = parser.parse_args(["diagram", *arguments])
    return int(parsed.run(parsed))


def test_command_prints_a_format(capsys: pytest.CaptureFixture[str]) -> None:
    table = TABLES["treadmill_guided"]
    for words, text in (
        ([], transition_table(table)),
        (["--format", "truth"], truth_table(table)),
        (["--format", "svg"], state_diagram_svg(table)),
        (["--format", "mermaid"], state_diagram_mermaid(table)),
    ):
        assert twin_gait_diagram("treadmill_guided", *words) == 0
        assert capsys.readouterr().out == text


def test_command_reads_a_file_and_refuses_a_file_that_is_not_a_table(tmp_path: Path) -> None:
    with raises(TwinGaitError, "moonwalk", "treadmill_guided"):
        twin_gait_diagram("moonwalk")
    broken = tmp_path / "broken.yaml"
    broken.write_text("schema_version: 2\njoints: [hip]\nphases: {}\ntransitions: []\n")
    with raises(TwinGaitError, "broken.yaml", "phases") as caught:
        twin_gait_diagram(str(broken))
    assert len(str(caught.value).splitlines()) == 1
