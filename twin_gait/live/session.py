"""Live session as the server of the pages uses it: messages in, events, states and frames out.

The walk runs in a separate process (:mod:`twin_gait.live.process`). Here a message of a page is processed,
checked by the rules of the check in a thread of this process, and sent to the walk as numbers; the walk never
waits for this. Stop, pause and the other actions that need no check have their own thread.
"""

from __future__ import annotations

import contextlib
import itertools
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from twin_gait.configuration.documents import dump_yaml, table_document
from twin_gait.configuration.events import changed_keys
from twin_gait.configuration.experiments import LoadedExperiment
from twin_gait.exceptions import ParameterError, RunDirectoryError, TwinGaitError
from twin_gait.files import write_new
from twin_gait.live.can_link import CanLink
from twin_gait.live.controls import EVERYTHING, ControlPanel, action_specs, action_values, fault_text
from twin_gait.live.forecast import FindingKey, find_errors, find_warnings, predict
from twin_gait.live.journal import complete
from twin_gait.live.protocol import (
    DoAction,
    Message,
    MessageRejected,
    SetControl,
    SetControls,
    State,
    Value,
    one_line,
    user_name,
)
from twin_gait.live.session_records import SessionRecorder
from twin_gait.live.settings_file import choose_step, settings_document
from twin_gait.live.telemetry import EventLog, WalkProcess
from twin_gait.runs.folders import check_target, journal_path
from twin_gait.runs.record import RUN_DIRECTORY
from twin_gait.simulation.settings import Settings, loop_numbers
from twin_gait.simulation.stepping import SteppedRun

# Actions that wait for changes that are being checked; other actions are sent to the walk immediately.
CHECKED = ("revert", "save", "save_settings")


@dataclass(kw_only=True, eq=False)
class LiveSession:
    """One live session; all methods may be called from any thread, and none waits for the walk.

    :meth:`start` starts the process of the walk. :meth:`close` must always be called: it ends the walk and
    writes its run directory.

    Attributes:
        event_log: Events of the session.
        walk: Process of the walk, and the state of its walks.
        panel: Controls of the experiment.
        settings: Present settings.
        controls: Controls of the panel with their present values.
        summaries: Summaries of the walks by their run directories, after these have been written at the end.
        number: Number of the session in the record, or None if it is not recorded.
        failure: Reason why a run directory could not be written, or empty.
    """

    loaded: LoadedExperiment  # experiment, whose duration is the longest time of a walk
    folder: Path  # run directory of the first walk
    user: str = ""  # name of the user of the session
    force: bool = False  # whether an existing run directory may be replaced
    pictures: bool = True  # whether to draw figures and animation at the end
    records: Path | None = None  # folder of the record of sessions, or None for no record
    can: str | None = None  # name of the CAN bus of the walk for open_bus, or None
    # called if the walk must be compiled first, which takes 10–20 s
    on_compile: Callable[[], None] = lambda: None
    # called with the reason if the walk is not stored
    on_store_failure: Callable[[str], None] = lambda text: None

    def __post_init__(self) -> None:
        """Prepare the session; raise MessageRejected if the name of the user is invalid in a message."""
        self.user = user_name(self.user)
        self._opened = self.loaded.document
        self.loaded = choose_step(self.loaded)
        self.folder = self.folder.expanduser().absolute()
        self.summaries, self.failure = dict[Path, dict[str, Any]](), ""
        self.number: int | None = None
        self._link: CanLink | None = None
        self.event_log = EventLog()
        self.panel = ControlPanel(self.loaded.experiment)
        self.settings: Settings = self.panel.preset
        self.controls = self.panel.controls(self.settings)
        self._known_errors: Mapping[FindingKey, str] = {}
        self._actions = tuple(action_specs(self.panel.simulation_setup))
        self.walk = WalkProcess(
            self.event_log,
            self.panel.simulation_setup,
            on_compile=self.on_compile,
            on_store_failure=self._report_store_failure,
        )
        self._check_executor, self._action_executor = (
            ThreadPoolExecutor(1, name) for name in ("live worker", "live hands")
        )

    # ------------------------------------------------------------------ start and end

    def start(self) -> None:
        """Start the process and wait until it walks.

        Raises RunDirectoryError if the run directory may not be used, MessageRejected if the experiment
        cannot be walked live, ParameterError if it has events or if the bus cannot be opened, and
        MissingOptionalDependency if a bus is given without python-can.
        """
        if journal_path(self.folder).exists():  # journal of an earlier session that was killed
            complete(journal_path(self.folder))
        check_target(self.folder, RUN_DIRECTORY, force=self.force)
        document, name = self.loaded.document, self.loaded.experiment.name
        if document.get("events"):
            has = "events, which only simulate executes"
            raise ParameterError(f"{name}: has {has}; leave them out with --set events=[]")
        if self.can is not None:
            self._link = CanLink(self.can, self.panel.simulation_setup, self.event_log, self.submit)
            self.walk.on_block = self._link.add_block
        records = None if self.records is None else str(self.records.expanduser().absolute())
        setup = {"document": document, "folder": str(self.folder), "force": self.force, "records": records}
        self.walk.start(setup)
        self._check_executor.submit(self._prepare).add_done_callback(Future.result)
        if self.records is not None:
            self.event_log.recorder = SessionRecorder(
                self.records, user=self.user, experiment=name, document=document, folder=self.folder
            )
            self.number = self.event_log.recorder.session

    def close(self) -> None:
        """End the walk, write the run directories, and close the record."""
        if self._link is not None:
            self._link.close()
        self.walk.close()
        for worker in (self._check_executor, self._action_executor):
            worker.shutdown(cancel_futures=True)
        try:
            if (journal := journal_path(self.folder)).exists():
                self.summaries = complete(journal, pictures=self.pictures)
        except RunDirectoryError as error:
            self.failure = f"{one_line(error)}; {self.recovery_hint}"
            self.event_log.emit("note", f"the run folder could not be written: {self.failure}")
        for folder in self.summaries:
            self.event_log.emit("note", f"the run is in {folder}")
        if self.event_log.recorder is not None:
            folders = [self.folder] if self.failure else self.summaries
            self.event_log.recorder.close(self.walk.status, self.event_log.tick, self.summary, folders)
            self.event_log.recorder = None

    @property
    def report_path(self) -> Path:
        """File of the report, next to the run directory."""
        return self.folder.with_name(f"{self.folder.name}-report.html")

    @property
    def report_command(self) -> list[str] | None:
        """Command that writes the report of the session, or None if the session is not recorded."""
        if self.records is None or self.number is None:
            return None
        record = ["--records", str(self.records), "report", str(self.number)]
        command = [sys.executable, "-P", "-m", "twin_gait", "sessions", *record]
        return [*command, "--out", str(self.report_path), "--force"]

    @property
    def summary(self) -> Mapping[str, Any]:
        """Summary of the last walk after its end; empty if its run directory could not be written."""
        return next(reversed(self.summaries.values()), {})

    def _report_store_failure(self, why: str) -> None:
        """Report that the walk is no longer stored: in the terminal, the record and the pages."""
        text = f"the walk is no longer saved: {why}; {self.recovery_hint}"
        self.event_log.emit("note", text)
        self.on_store_failure(text)

    @property
    def recovery_hint(self) -> str:
        """Command that restores the part of the walk that was stored."""
        return f"free disk space, then write the saved part with: twin-gait sessions complete {self.folder}"

    # ------------------------------------------------------------------ functions for pages

    def submit(self, message: Message) -> Future[bool] | None:
        """Accept a message of a page; an event reports its result.

        Returns a future whose result is whether the message was applied; None if the session is closed.
        """
        checked = not isinstance(message, DoAction) or message.action in CHECKED
        worker = self._check_executor if checked else self._action_executor
        with contextlib.suppress(RuntimeError):  # the session has been closed
            result = worker.submit(self._work, message)
            # An unexpected error of the work is an internal error, which is printed.
            result.add_done_callback(Future.result)
            return result
        return None

    def state(self) -> State:
        """Return the state of the panel with its present values."""
        table = self.panel.simulation_setup.table
        return State(
            experiment=self.loaded.experiment.name, phases=table.phase_names, joints=tuple(table.joints),
            controls=self.controls, actions=self._actions,
        )  # fmt: skip

    # ------------------------------------------------------------------ processing of messages

    def _work(self, message: Message) -> bool:
        """Apply a message, or emit the reason of its rejection; return whether it was applied."""
        try:
            if isinstance(message, SetControl):
                settings = self.panel.set(self.settings, message.control, message.value)
                self._apply_settings(message, settings, message.control)
            elif isinstance(message, SetControls):
                settings = self.panel.set_all(self.settings, message.changes)
                self._apply_settings(message, settings, *message.changes)
            elif message.action == "revert":
                name = str(action_values(self._actions, message)["control"])
                settings = self.panel.revert(self.settings, name)
                self._apply_settings(message, settings, name)
            elif message.action == "save":
                self._save_table(message)
            elif message.action == "save_settings":
                self._save_settings(message, str(action_values(self._actions, message)["patient"]))
            else:
                self._do(message, action_values(self._actions, message))
        except TwinGaitError as error:
            self.event_log.answer(message, "refused", one_line(error), value=getattr(message, "value", None))
            return False
        return True

    def _prepare(self) -> None:
        """Find the errors that exist before any change, and build the run for forecasts."""
        self._known_errors = find_errors(self.settings)
        self._forecast_run = SteppedRun(self.panel.simulation_setup)

    def _apply_settings(self, message: Message, settings: Settings, *names: str) -> None:
        """Check new settings of some controls, and send them to the walk, or only predict their effect."""
        controls, known = self.panel.controls(settings), find_errors(settings)
        old, new = ({item.name: item.value for item in shown} for shown in (self.controls, controls))
        changes = [{"subject": name, "before": old.get(name), "value": new.get(name)} for name in names]
        texts = [_describe_change(name, old.get(name), new.get(name)) for name in names]
        for rule, error in known.items():
            if rule not in self._known_errors:
                raise MessageRejected(error)
        if message.kind == "try":
            now = self.walk.send_command({"command": "snapshot"})
            known_warnings = find_warnings(self.settings)
            warnings = tuple(item for item in find_warnings(settings) if item not in known_warnings)
            found = predict(self._forecast_run, now["snapshot"], settings, warnings)
            change = changes[0] if len(changes) == 1 else {"subject": ""}
            text, forecast = f"forecast of {'; '.join(texts)}: {found.text}", asdict(found)
            self.event_log.answer(message, "forecast", text, tick=now["tick"], **change, forecast=forecast)
            return
        command = {
            "command": "settings",
            "numbers": loop_numbers(settings),
            "user": message.user,
            "set": changed_keys(self.settings, settings),
            "whole": changed_keys(self.panel.preset, settings),
        }
        tick = self.walk.send_command(command)["tick"]
        if settings.table != self.settings.table and self.event_log.recorder is not None:
            self.event_log.recorder.table(table_document(settings.table), tick)
        self.settings, self._known_errors, self.controls = settings, known, controls
        for change, text in zip(changes, texts, strict=True):
            self.event_log.answer(message, "applied", text, tick=tick, **change)

    def _do(self, message: DoAction, values: Mapping[str, Value]) -> None:
        """Send an action to the process of the walk, and emit its result."""
        name = str(message.action)
        if name == "fault":
            values = {"fault": fault_text(values)}
        answer = self.walk.send_command({"command": name, "user": message.user, **values})
        self.event_log.answer(message, "applied", answer["text"], tick=answer["tick"])

    def _save_table(self, message: DoAction) -> None:
        """Write the table as YAML next to the run directory."""
        table = self.settings.table
        names = (f"{self.folder.name}-table-{number}.yaml" for number in itertools.count(1))
        path = self._write_new(names, {**table_document(table), "name": f"{table.name}_live"})
        text = f"saved {path}; run it with: twin-gait simulate EXPERIMENT --set table={path}"
        self.event_log.answer(message, "applied", text, value=str(path))

    def _save_settings(self, message: DoAction, patient: str) -> None:
        """Write the settings of a patient as an experiment file next to the run directory."""
        now = datetime.now().astimezone()
        document = settings_document(self._opened, self.panel.preset, self.settings, patient, now)
        others = (f"-{number}" for number in itertools.count(2))
        names = (f"{patient}-{now:%Y-%m-%d}{end}.yaml" for end in itertools.chain([""], others))
        path = self._write_new(names, document)
        if self.event_log.recorder is not None:
            self.event_log.recorder.patient(patient)
        text = f"saved {path}; start the next session with: twin-gait live {shlex.quote(str(path))}"
        self.event_log.answer(message, "applied", text, value=str(path))

    def _write_new(self, names: Iterable[str], document: dict[str, Any]) -> Path:
        """Write a document under the first name that is free in the folder of the run directories."""
        return write_new((self.folder.with_name(name) for name in names), dump_yaml(document))


def _describe_change(subject: str, before: Value | None, value: Value | None) -> str:
    if subject == EVERYTHING:
        return "reset all parameters"
    shown = (f"{item:.4g}" if isinstance(item, float) else str(item) for item in (before, value))
    return f"{subject}: {' → '.join(shown)}"
