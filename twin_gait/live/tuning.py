"""Changes of live settings: held to the rules of ``twin-gait check``, handed to the walk, or tried ahead."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from twin_gait.checking.check import build_case
from twin_gait.checking.finding import CheckCase, Finding, Rule, Severity, waive
from twin_gait.checking.leaving import cannot_leave
from twin_gait.checking.sense import (
    equilibrium_beyond_limits,
    unusual_damping_ratio,
    unusual_gain,
    unusual_stiffness,
)
from twin_gait.checking.stability import effective_damping, unstable
from twin_gait.checking.torques import stiffness_not_served, torque_jump
from twin_gait.configuration.documents import table_document
from twin_gait.configuration.experiments import LoadedExperiment
from twin_gait.exceptions import ParameterError
from twin_gait.live.controls import EVERYTHING, Panel
from twin_gait.live.handle import LoopProcess
from twin_gait.live.news import EventBook
from twin_gait.live.protocol import DoAction, MessageRefused, Response, SetControl, Value
from twin_gait.live.settings import Mode, Settings, effect_of, loop_numbers
from twin_gait.simulation.problem import Problem

# Rules that k, b, θ0 and G can break, quick ones first; an error of one of them refuses a change. The phases
# of the monitor's controls are all alike: there is nothing to leave, and no switch to jump at.
GATE: tuple[Rule, ...] = (unstable, cannot_leave, torque_jump)
GATE_OF_MONITOR: tuple[Rule, ...] = (unstable,)
# What these find is told after a change has been applied.
TOLD: tuple[Rule, ...] = (
    equilibrium_beyond_limits, unusual_gain, unusual_stiffness, unusual_damping_ratio, effective_damping,
    stiffness_not_served,
)  # fmt: skip
TOLD_OF_MONITOR: tuple[Rule, ...] = (equilibrium_beyond_limits, unusual_gain, effective_damping)

Place = tuple[str, str | None, str | None, str | None]


class Checked(NamedTuple):
    """What the check says of some settings."""

    case: CheckCase  # what was checked
    errors: tuple[Finding, ...]  # findings that refuse them

    @property
    def places(self) -> frozenset[Place]:
        """Rule and place of every error."""
        return frozenset(place_of(item) for item in self.errors)


def check_settings(settings: Settings, known: frozenset[Place] = frozenset()) -> Checked:
    """Hold settings to the rules whose errors make them unsafe.

    ``known``: errors that are there already, and so are not the fault of a change. Returns the checked; it
    stops at the first rule with an error that is not known.
    """
    case = build_case(settings.driving.table, settings.driving)
    errors: list[Finding] = []
    for rule in GATE if settings.mode is Mode.WALK else GATE_OF_MONITOR:
        found = [item for item in rule(case) if item.severity is Severity.ERROR]
        errors += found
        if any(place_of(item) not in known for item in found):
            break
    return Checked(case, tuple(errors))


def refusal(checked: Checked, known: frozenset[Place]) -> str:
    """Why settings are refused, in one sentence; empty if they are not."""
    new = [item for item in checked.errors if place_of(item) not in known]
    return described(new[0], way_out=True) if new else ""


def warnings(settings: Settings) -> dict[Place, str]:
    """What the check warns of, where the table does not waive it."""
    case = build_case(settings.driving.table, settings.driving)
    found: list[Finding] = []
    for rule in TOLD if settings.mode is Mode.WALK else TOLD_OF_MONITOR:
        found += rule(case)
    return {place_of(item): described(item) for item in _live(case, found)}


def _live(case: CheckCase, found: Sequence[Finding]) -> list[Finding]:
    marked = waive(case.table, found)
    return [item for item in marked if item.severity is Severity.WARNING and not item.waived]


def place_of(finding: Finding) -> Place:
    """Rule, phase, transition and side that tell one finding from another."""
    side = None if finding.side is None else str(finding.side)
    return finding.rule, finding.phase, finding.transition, side


def described(finding: Finding, *, way_out: bool = False) -> str:
    """A finding in one sentence."""
    where = finding.transition or finding.phase or ""
    text = f"{finding.rule}{f' ({where})' if where else ''}: {finding.reason}"
    return f"{text}; {finding.suggestion}" if way_out else text


class Tuning:
    """The settings of a session; all changes come from one thread.

    Attributes:
        settings: In force.
        controls: Of the panel with the present values.
    """

    def __init__(self, loaded: LoadedExperiment, loop: LoopProcess, book: EventBook) -> None:
        """Begin with the settings of an experiment."""
        self._document, self._loop, self._book = loaded.document, loop, book
        self._panel = Panel(loaded.experiment)
        self.settings = self._panel.preset
        self.controls = self._panel.controls(self.settings)
        self._numbers = loop_numbers(self.settings)
        self._known: frozenset[Place] = frozenset()
        self._warned: dict[Place, str] = {}
        self._checked: tuple[Settings, frozenset[Place], Checked] | None = None
        self._forecaster = self._new_forecaster()

    @property
    def problem(self) -> Problem:
        """The experiment as the session began."""
        return self._panel.problem

    def check_first(self) -> None:
        """Check what the session begins with."""
        checked = check_settings(self.settings)
        self._known = checked.places
        if checked.errors:
            found = tuple(described(item) for item in checked.errors)
            self._book.emit(
                Response.NOTE, "the check finds errors in what the session begins with", warnings=found
            )
        self._warned = warnings(self.settings)

    def record_table(self, tick: int) -> None:
        """Record the gait table as it is from a tick on."""
        if self._book.recorder is not None:
            self._book.recorder.table(table_document(self.settings.table), tick)

    # ------------------------------------------------------------------ changing

    def set(self, message: SetControl) -> None:
        """Set a control, or foresee what setting it would do.

        Raises MessageRefused if there is no such control, or the value is out of range or against the rules.
        """
        before = self._value_of(message.control)
        settings = self._panel.set(self.settings, message.control, message.value)
        if message.trying:
            self._foresee(settings, message, before)
        else:
            self._change(settings, message, message.control, message.value, before)

    def revert(self, message: DoAction, name: str) -> None:
        """Set a control, or everything, to what the session began with.

        Raises MessageRefused if there is no such control, or the rules forbid it.
        """
        before = None if name == EVERYTHING else self._value_of(name)
        self._change(self._panel.revert(self.settings, name), message, name, None, before)

    def _value_of(self, control: str) -> Value | None:
        found = [item.value for item in self.controls if item.name == control]
        return found[0] if found else None

    def _change(
        self,
        settings: Settings,
        message: SetControl | DoAction,
        name: str,
        value: Value | None,
        before: Value | None,
    ) -> None:
        """Check new settings, hand them to the walk, and tell what they do."""
        checking = settings.driving != self.settings.driving
        known = self._check(settings).places if checking else self._known
        numbers = loop_numbers(settings)
        if value is None and name != EVERYTHING:
            value = next(item.value for item in self._panel.controls(settings) if item.name == name)
        text = _told(name, before, value)
        note = {"user": message.user, "subject": name, "before": before, "value": value, "text": text}
        new_table = settings.table != self.settings.table
        table = table_document(settings.table) if new_table else None
        answer = self._loop.ask(
            {"command": "settings", "numbers": numbers.to_dict(), "table": table, "note": note}
        )
        effect = effect_of(self._numbers, numbers, self.problem)
        self.settings, self._numbers, self._known = settings, numbers, known
        self.controls = self._panel.controls(settings)
        self._tell(
            Response.APPLIED, text, message, answer["tick"], subject=name, value=value, before=before,
            effect=effect,
        )  # fmt: skip
        if new_table:
            self.record_table(answer["tick"])
        if checking:
            self._warn(settings)

    def _tell(
        self, response: Response, text: str, message: SetControl | DoAction, tick: int, **rest: Any
    ) -> None:
        self._book.emit(response, text, tick=tick, id=message.id, user=message.user, **rest)

    def _check(self, settings: Settings) -> Checked:
        """Hold settings to the rules; those that have just been tried have been held to them."""
        if self._checked is None or self._checked[:2] != (settings, self._known):
            self._checked = (settings, self._known, check_settings(settings, self._known))
        checked = self._checked[2]
        reason = refusal(checked, self._known)
        if reason:
            raise MessageRefused(reason)
        return checked

    def _warn(self, settings: Settings) -> None:
        """Tell what the check warns of since the last change."""
        found = warnings(settings)
        new = [text for place, text in found.items() if place not in self._warned]
        self._warned = found
        if new:
            self._book.emit(Response.NOTE, "the check warns", warnings=tuple(new))

    # ------------------------------------------------------------------ looking ahead

    def _new_forecaster(self) -> LoopProcess:
        return LoopProcess(
            "forecast",
            on_frame=lambda line: None,
            on_message=lambda message: None,
            on_end=lambda status: None,
        )

    def start_forecaster(self) -> None:
        """Start the process that looks ahead, or a new one."""
        self._forecaster.close()
        self._forecaster = self._new_forecaster()
        self._forecaster.start({"document": self._document, "numbers": self._numbers.to_dict()})

    def close(self) -> None:
        """End the process that looks ahead."""
        self._forecaster.close()

    def _foresee(self, settings: Settings, message: SetControl, before: Value | None) -> None:
        """Forecast new settings; the walk goes on as it does."""
        if not self._forecaster.alive:
            self.start_forecaster()
        moment = self._loop.ask({"command": "moment"})
        request = {
            "command": "forecast",
            "moment": moment["moment"],
            "numbers": loop_numbers(settings).to_dict(),
        }
        coming = self._forecaster.command(request, lambda answer: None)
        if settings.driving != self.settings.driving:  # held to the rules in the meantime
            self._check(settings)
        try:
            forecast = self._forecaster.answer(coming)["forecast"]
        except ParameterError as error:
            raise MessageRefused("no forecast: its process has died; try again, or apply at once") from error
        text = f"forecast of {_told(message.control, before, message.value)}: {forecast['text']}"
        self._tell(
            Response.FORECAST, text, message, moment["tick"], subject=message.control, value=message.value,
            before=before, forecast=forecast,
        )  # fmt: skip


def _told(name: str, before: Value | None, value: Value | None) -> str:
    if name == EVERYTHING:
        return "everything as it began"
    return f"{name}: {_shown(before)} → {_shown(value)}"


def _shown(value: Value | None) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value).lower() if value is not None else "?"
