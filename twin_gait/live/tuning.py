"""Changes of live settings: held to the rules of ``twin-gait check``, handed to the walk, or tried ahead."""

from collections.abc import Iterable, Mapping
from typing import Any

from twin_gait.checking import leaving, sense, stability, torques
from twin_gait.checking.check import build_case
from twin_gait.checking.finding import Finding, Rule, Severity, waive
from twin_gait.configuration.documents import table_document
from twin_gait.configuration.experiments import LoadedExperiment
from twin_gait.exceptions import ParameterError
from twin_gait.live.controls import EVERYTHING, Panel
from twin_gait.live.news import EventBook
from twin_gait.live.process import LoopProcess
from twin_gait.live.protocol import DoAction, Message, MessageRefused, Response, SetControl, Value
from twin_gait.live.settings import Mode, Settings, effect_of, loop_numbers
from twin_gait.simulation.problem import Problem

# Rules that k, b, θ0 and G can break, quick ones first; an error of one of them refuses a change. The phases
# of the monitor's controls are all alike: there is nothing to leave, and no switch to jump at.
GATE: tuple[Rule, ...] = (stability.unstable, leaving.cannot_leave, torques.torque_jump)
GATE_OF_MONITOR: tuple[Rule, ...] = (stability.unstable,)
# What these find is told after a change has been applied.
TOLD: tuple[Rule, ...] = (
    sense.equilibrium_beyond_limits, sense.unusual_gain, sense.unusual_stiffness, sense.unusual_damping_ratio,
    stability.effective_damping, torques.stiffness_not_served,
)  # fmt: skip
TOLD_OF_MONITOR: tuple[Rule, ...] = (
    sense.equilibrium_beyond_limits, sense.unusual_gain, stability.effective_damping,
)  # fmt: skip

Place = tuple[str, str | None, str | None, str | None]  # rule, phase, transition and side of a finding
Known = frozenset[Place]  # errors that are there already, and so are not the fault of a change


def check_settings(settings: Settings, known: Known = frozenset()) -> tuple[Finding, ...]:
    """Hold settings to the rules whose errors make them unsafe, up to the first with an error that is new."""
    case = build_case(settings.driving.table, settings.driving)
    errors: list[Finding] = []
    for rule in GATE if settings.mode is Mode.WALK else GATE_OF_MONITOR:
        errors += [item for item in rule(case) if item.severity is Severity.ERROR]
        if any(place_of(item) not in known for item in errors):
            break
    return tuple(errors)


def refusal(errors: Iterable[Finding], known: Known) -> str:
    """Why settings are refused, in one sentence; empty if they are not."""
    new = [item for item in errors if place_of(item) not in known]
    return f"{described(new[0])}; {new[0].suggestion}" if new else ""


def warnings(settings: Settings) -> dict[Place, str]:
    """What the check warns of, where the table does not waive it."""
    case = build_case(settings.driving.table, settings.driving)
    rules = TOLD if settings.mode is Mode.WALK else TOLD_OF_MONITOR
    found = waive(case.table, [finding for rule in rules for finding in rule(case)])
    told = [item for item in found if item.severity is Severity.WARNING and not item.waived]
    return {place_of(item): described(item) for item in told}


def place_of(finding: Finding) -> Place:
    """What tells one finding from another."""
    side = None if finding.side is None else str(finding.side)
    return finding.rule, finding.phase, finding.transition, side


def places_of(errors: Iterable[Finding]) -> Known:
    """What tells each of some errors from others."""
    return frozenset(map(place_of, errors))


def described(finding: Finding) -> str:
    """A finding in one sentence."""
    where = finding.transition or finding.phase or ""
    return f"{finding.rule}{f' ({where})' if where else ''}: {finding.reason}"


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
        self._known: Known = frozenset()
        self._warned: dict[Place, str] = {}
        self._forecaster = LoopProcess("forecast")

    @property
    def problem(self) -> Problem:
        """The experiment as the session began."""
        return self._panel.problem

    def check_first(self) -> None:
        """Check what the session begins with."""
        errors = check_settings(self.settings)
        self._known, self._warned = places_of(errors), warnings(self.settings)
        if errors:
            found = tuple(map(described, errors))
            text = "the check finds errors in what the session begins with"
            self._book.emit(Response.NOTE, text, warnings=found)

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
        done = self._foresee if message.kind == "try" else self._change
        done(settings, message, {"subject": message.control, "before": before, "value": message.value})

    def revert(self, message: DoAction, name: str) -> None:
        """Set a control, or everything, to what the session began with.

        Raises MessageRefused if there is no such control, or the rules forbid it.
        """
        settings, value = self._panel.revert(self.settings, name), None
        if name != EVERYTHING:
            value = next(item.value for item in self._panel.controls(settings) if item.name == name)
        self._change(settings, message, {"subject": name, "before": self._value_of(name), "value": value})

    def _value_of(self, control: str) -> Value | None:
        return next((item.value for item in self.controls if item.name == control), None)

    def _change(self, settings: Settings, message: Message, change: Mapping[str, Any]) -> None:
        """Check new settings, hand them to the walk, and tell what they do."""
        checking = settings.driving != self.settings.driving
        known = self._check(settings) if checking else self._known
        numbers, text = loop_numbers(settings), _told(**change)
        new_table = settings.table != self.settings.table
        answer = self._loop.ask(
            {
                "command": "settings",
                "numbers": numbers,
                "table": table_document(settings.table) if new_table else None,
                "note": {"user": message.user, **change, "text": text},
            }
        )
        effect = effect_of(self._numbers, numbers, self.problem)
        self.settings, self._numbers, self._known = settings, numbers, known
        self.controls = self._panel.controls(settings)
        self._book.answer(message, Response.APPLIED, text, tick=answer["tick"], **change, effect=effect)
        if new_table:
            self.record_table(answer["tick"])
        if checking:
            found = warnings(settings)
            new = tuple(text for place, text in found.items() if place not in self._warned)
            self._warned = found
            if new:
                self._book.emit(Response.NOTE, "the check warns", warnings=new)

    def _check(self, settings: Settings) -> Known:
        """Hold settings to the rules; gives the errors that are there, or were before."""
        errors = check_settings(settings, self._known)
        reason = refusal(errors, self._known)
        if reason:
            raise MessageRefused(reason)
        return places_of(errors)

    # ------------------------------------------------------------------ looking ahead

    def start_forecaster(self) -> None:
        """Start the process that looks ahead, or a new one."""
        self._forecaster.close()
        self._forecaster = LoopProcess("forecast")
        self._forecaster.start({"document": self._document, "numbers": self._numbers})

    def close(self) -> None:
        """End the process that looks ahead."""
        self._forecaster.close()

    def _foresee(self, settings: Settings, message: Message, change: Mapping[str, Any]) -> None:
        """Forecast new settings; the walk goes on as it does."""
        if not self._forecaster.alive:
            self.start_forecaster()
        now, numbers = self._loop.ask({"command": "moment"}), loop_numbers(settings)
        request = {"command": "forecast", "moment": now["moment"], "numbers": numbers}
        coming = self._forecaster.command(request)
        if settings.driving != self.settings.driving:  # held to the rules in the meantime
            self._check(settings)
        try:
            forecast = self._forecaster.answer(coming)["forecast"]
        except ParameterError as error:
            raise MessageRefused("no forecast: its process has died; try again, or apply at once") from error
        text = f"forecast of {_told(**change)}: {forecast['text']}"
        self._book.answer(message, Response.FORECAST, text, tick=now["tick"], **change, forecast=forecast)


def _told(subject: str, before: Value | None, value: Value | None) -> str:
    if subject == EVERYTHING:
        return "everything as it began"
    return f"{subject}: {_shown(before)} → {_shown(value)}"


def _shown(value: Value | None) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value).lower() if value is not None else "?"
