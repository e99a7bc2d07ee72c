"""Changes of live settings: held to the rules of ``twin-gait check``, handed to the walk, or tried ahead."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from twin_gait.checking import leaving, stability, torques
from twin_gait.checking.check import build_case
from twin_gait.checking.finding import Finding, Rule, Severity
from twin_gait.configuration.documents import table_document
from twin_gait.live.controls import EVERYTHING, Panel
from twin_gait.live.forecast import foresee
from twin_gait.live.news import EventBook, WalkNews
from twin_gait.live.protocol import Control, DoAction, Message, MessageRefused, SetControl, Value
from twin_gait.live.settings import WALK, Settings, loop_numbers
from twin_gait.live.stepping import SteppedRun

# Rules that k, b, θ0 and G can break; an error of one of them refuses a change. The phases of the monitor's
# controls are all alike: there is nothing to leave, and no switch to jump at.
GATE: tuple[Rule, ...] = (stability.unstable, leaving.cannot_leave, torques.torque_jump)

Place = tuple[str, str | None, str | None, str | None]  # rule, phase, transition and side of a finding


def errors_of(settings: Settings) -> dict[Place, str]:
    """Errors of the check that make settings unsafe: what tells each from others, and a sentence."""
    case = build_case(settings.driving.table, settings.driving)
    rules = GATE if settings.mode == WALK else GATE[:1]
    found = [item for rule in rules for item in rule(case) if item.severity is Severity.ERROR]
    return {(item.rule, item.phase, item.transition, item.side): _described(item) for item in found}


def _described(finding: Finding) -> str:
    where = finding.transition or finding.phase
    return f"{finding.rule}{f' ({where})' if where else ''}: {finding.reason}; {finding.suggestion}"


class Tuning:
    """The settings of a session; all changes come from one thread.

    Attributes:
        panel: The controls that there are.
        settings: In force.
        controls: Of the panel with the present values.
    """

    def __init__(self, panel: Panel, loop: WalkNews, book: EventBook) -> None:
        """Begin with the settings of a panel."""
        self.panel, self._loop, self._book = panel, loop, book
        self.settings = panel.preset
        self.controls = panel.controls(self.settings)
        self._known: Mapping[Place, str] = {}

    def prepare(self) -> None:
        """Find errors that are there, and so not the fault of a change, and the run that looks ahead."""
        self._known = errors_of(self.settings)
        self._ahead = SteppedRun(self.panel.problem)

    # ------------------------------------------------------------------ changing

    def set(self, message: SetControl) -> None:
        """Set a control, or foresee what setting it would do.

        Raises MessageRefused if there is no such control, or the value is out of range or against the rules.
        """
        before = _value_in(self.controls, message.control)
        settings = self.panel.set(self.settings, message.control, message.value)
        done = self._foresee if message.kind == "try" else self._change
        done(settings, message, {"subject": message.control, "before": before, "value": message.value})

    def revert(self, message: DoAction, name: str) -> None:
        """Set a control, or everything, to what the session began with.

        Raises MessageRefused if there is no such control, or the rules forbid it.
        """
        settings = self.panel.revert(self.settings, name)
        value = _value_in(self.panel.controls(settings), name)
        before = _value_in(self.controls, name)
        self._change(settings, message, {"subject": name, "before": before, "value": value})

    def _change(self, settings: Settings, message: Message, change: Mapping[str, Any]) -> None:
        """Check new settings, hand them to the walk, and tell what they do."""
        known, text = self._check(settings), _told(**change)
        note = {"user": message.user, **change, "text": text}
        answer = self._loop.ask({"command": "settings", "numbers": loop_numbers(settings), "note": note})
        new_table = settings.table != self.settings.table
        self.settings, self._known = settings, known
        self.controls = self.panel.controls(settings)
        self._book.answer(message, "applied", text, tick=answer["tick"], **change)
        if new_table and self._book.recorder is not None:
            self._book.recorder.table(table_document(settings.table), answer["tick"])

    def _check(self, settings: Settings) -> Mapping[Place, str]:
        """Hold settings to the rules; gives the errors that are there, and were before."""
        if settings.driving == self.settings.driving:
            return self._known
        errors = errors_of(settings)
        for place, text in errors.items():
            if place not in self._known:
                raise MessageRefused(text)
        return errors

    # ------------------------------------------------------------------ looking ahead

    def _foresee(self, settings: Settings, message: Message, change: Mapping[str, Any]) -> None:
        """Forecast new settings; the walk goes on as it does."""
        self._check(settings)
        now = self._loop.ask({"command": "moment"})
        found = foresee(self._ahead, now["moment"], loop_numbers(settings))
        text, forecast = f"forecast of {_told(**change)}: {found.text}", asdict(found)
        self._book.answer(message, "forecast", text, tick=now["tick"], **change, forecast=forecast)


def _value_in(controls: tuple[Control, ...], name: str) -> Value | None:
    return next((item.value for item in controls if item.name == name), None)


def _told(subject: str, before: Value | None, value: Value | None) -> str:
    if subject == EVERYTHING:
        return "everything as it began"
    return f"{subject}: {_shown(before)} → {_shown(value)}"


def _shown(value: Value | None) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value).lower() if value is not None else "?"
