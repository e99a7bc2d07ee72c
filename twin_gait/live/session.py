"""A live session as the server of the pages sees it: messages in, events, states and frames out.

The walk runs in a process of its own (:mod:`twin_gait.live.process`). Here a message of a page is
understood, held to the rules of the check in a thread of this process, and handed over as numbers; the walk
waits for none of it. Stop, pause and the other actions that need no check do not wait for one either.
"""

from __future__ import annotations

import itertools
import json
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from twin_gait.configuration.documents import dump_yaml, table_document
from twin_gait.configuration.experiments import LoadedExperiment, presets
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.files import write_new
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.live.actions import EVERYTHING, Actions
from twin_gait.live.controls import KM_PER_H, Panel
from twin_gait.live.finishing import complete, complete_all
from twin_gait.live.handle import LoopProcess
from twin_gait.live.loop import MOST_TRACES
from twin_gait.live.protocol import (
    Action,
    DoAction,
    Event,
    Message,
    MessageRefused,
    Response,
    SetControl,
    State,
    Value,
    dump,
)
from twin_gait.live.rules import Checked, Place, check_settings, described, refusal, warnings
from twin_gait.live.session_records import SessionRecorder
from twin_gait.live.settings import Settings, effect_of, loop_numbers
from twin_gait.runs.folders import check_target, journal_of
from twin_gait.runs.record import RUN_DIRECTORY
from twin_gait.scenario import TreadmillScenario
from twin_gait.simulation.watching import ticks
from twin_gait.viewer.live.figure import Trace

MOST_EVENTS = 10_000  # that are kept for pages that come late
# Actions that go straight to the walk, whatever is being checked meanwhile.
DIRECT = frozenset({Action.WALK, Action.PAUSE, Action.STEP, Action.STOP, Action.PUSH, Action.FAULT})


class LatestFrame(NamedTuple):
    """The newest frame.

    Attributes:
        number: Counts frames; 0 before the first.
        text: The frame as JSON, ready for a page.
    """

    number: int
    text: str


class LiveSession:
    """One live session; all methods may be called from any thread and none waits for the walk.

    Use it as a context manager: leaving it ends the walk and writes its run folder.

    Attributes:
        folder: Run folder of the first walk.
        folders: Run folders that have been written.
        summary: Content of the last walk's ``summary.json``; empty before the end.
        failure: Why the process could not walk or write, or empty.
        death: How the process of the walk died, or empty.
    """

    def __init__(
        self,
        loaded: LoadedExperiment,
        folder: Path,
        *,
        user: str = "",
        force: bool = False,
        pictures: bool = True,
        records: Path | None = None,
        on_compile: Callable[[], None] | None = None,
        on_step: Callable[[str], None] | None = None,
    ) -> None:
        """Prepare the session; :meth:`start` starts the process.

        Args:
            loaded: Experiment; its duration is the longest time of a walk.
            force: Whether an existing run folder may be replaced.
            pictures: Whether to draw figures and animation at the end.
            records: Folder of the record of sessions, or None to keep no record.
            on_compile: Called if the walk has to be compiled first, which takes 10 to 20 s.
            on_step: Called at the end with the name of each file before it is written.
        """
        self.folder, self.folders = Path(folder).expanduser().absolute(), list[Path]()
        self.summary: dict[str, Any] = {}
        self.failure = self.death = ""
        self._loaded, self._user = loaded, user
        self._setup = {
            "document": loaded.document,
            "folder": str(self.folder),
            "force": force,
            "pictures": pictures,
        }
        self._records, self._on_compile = records, on_compile
        self._on_step = on_step or (lambda name: None)
        self._walks: list[Path] = []  # run folders to come
        self._panel = Panel(loaded.experiment)
        self._actions = Actions(self._panel.problem)
        self._settings = self._panel.preset
        self._numbers = loop_numbers(self._settings)
        self._known: frozenset[Place] = frozenset()
        self._warned: dict[Place, str] = {}
        self._loop = LoopProcess(on_frame=self._note_frame, on_message=self._hear, on_end=self._note_end)
        self._forecaster = self._new_forecaster()
        self._checked: tuple[Settings, frozenset[Place], Checked] | None = None
        self._recorder: SessionRecorder | None = None
        self._frame = LatestFrame(0, "")
        self._traces: deque[Trace] = deque(maxlen=MOST_TRACES)
        self._events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self._serial = 0
        self._state: State | None = None
        self._tick, self._status = 0, "starting"
        self._saved: list[str] = []
        self._queue: deque[Message] = deque()
        self._work, self._ready = threading.Condition(), threading.Event()
        self._lock, self._closing = threading.RLock(), False
        self._worker: threading.Thread | None = None
        self._renew_state()

    # ------------------------------------------------------------------ beginning and end

    def __enter__(self) -> LiveSession:
        """Start."""
        self.start()
        return self

    def __exit__(self, *exception: object) -> None:
        """End."""
        self.close()

    def start(self) -> None:
        """Start the process and wait until it walks.

        Raises:
            RunDirectoryError: If the run folder may not be used.
            ParameterError: If the experiment cannot be walked live.
        """
        if journal_of(self.folder).exists():  # of an earlier session that was killed
            complete(journal_of(self.folder))
        check_target(self.folder, RUN_DIRECTORY, force=bool(self._setup["force"]))
        try:
            self._begin()
        except BaseException:
            self._loop.close()
            self._forecaster.close()
            raise
        self._worker = threading.Thread(target=self._work_off, name="live worker", daemon=True)
        self._worker.start()
        self._loop.ask({"command": "walk"})

    def _begin(self) -> None:
        """Start the process; while it gets ready, check what the session begins with."""
        self._loop.start(self._setup)
        checked = check_settings(self._settings)
        self._known = checked.places
        if checked.errors:
            found = tuple(described(item) for item in checked.errors)
            self._emit(
                Response.NOTE, "the check finds errors in what the session begins with", warnings=found
            )
        self._warned = warnings(self._settings)
        self._ready.wait()
        if self.failure:
            raise ParameterError(self.failure)
        self._start_forecaster()
        if self._records is not None:
            self._recorder = SessionRecorder(
                self._records,
                user=self._user,
                experiment=self._loaded.experiment.name,
                document=self._loaded.document,
            )
            self._recorder.table(table_document(self._settings.table), 0)
            self._record_folders()

    @property
    def alive(self) -> bool:
        """Whether the process of the walk is there."""
        return self._loop.alive

    @property
    def pid(self) -> int | None:
        """Number of the process of the walk."""
        return self._loop.pid

    @property
    def status(self) -> str:
        """What the walk does, as in :class:`~twin_gait.live.protocol.Frame`."""
        return self._status

    def close(self) -> dict[str, Any]:
        """End the walk, wait until its run folder is written, and close the record.

        Returns:
            The summary of the last walk; empty if it could not be written, see :attr:`failure`.
        """
        with self._work:
            if self._closing:
                return self.summary
            self._closing = True
            self._work.notify_all()
        self._loop.close()
        if self._worker is not None:
            self._worker.join()
        self._forecaster.close()
        complete_all(map(journal_of, self._walks), self._hear, pictures=True)  # those that it left behind
        if self._recorder is not None:
            folders = [str(item) for item in self.folders]
            self._recorder.close(self._status, self._tick, self.summary, folders)
        return self.summary

    # ------------------------------------------------------------------ what pages ask for

    def submit(self, message: Message) -> None:
        """Take a message of a page; an event tells what became of it."""
        if isinstance(message, DoAction) and message.action in DIRECT:
            self._guarded(message, lambda: self._do_directly(message))
            return
        with self._work:
            self._queue.append(message)
            self._work.notify_all()

    def refuse(self, reason: str, *, id: str = "", user: str = "") -> Event:
        """Record that a message could not even be read."""
        return self._emit(Response.REFUSED, reason, id=id, user=user)

    def newest_frame(self) -> LatestFrame:
        """The newest frame; its number tells whether it is a new one."""
        return self._frame

    def traces(self) -> list[Trace]:
        """What the curves did since the last call, in order; of a long time the last eight seconds."""
        return [self._traces.popleft() for _ in range(len(self._traces))]

    def events(self, after: int = 0) -> list[Event]:
        """Events since one of them.

        Args:
            after: Serial number of the last event that is known; 0 gives all that are kept.
        """
        with self._lock:
            return [item for item in self._events if item.serial > after]

    def state(self) -> State:
        """The panel with its present values."""
        assert self._state is not None  # start() made it
        return self._state

    # ------------------------------------------------------------------ working them off

    def _work_off(self) -> None:
        while True:
            with self._work:
                while not self._queue and not self._closing:
                    self._work.wait()
                if self._closing:
                    return
                message = self._queue.popleft()
                overtaken = any(_replaces(later, message) for later in self._queue)
            if overtaken:
                self._refuse(message, "overtaken by a newer value")
            else:
                self._guarded(message, lambda taken=message: self._handle(taken))  # type: ignore[misc]

    def _guarded(self, message: Message, handle: Callable[[], None]) -> None:
        try:
            handle()
        except TwinGaitError as error:
            self._refuse(message, " ".join(str(error).split()))

    def _refuse(self, message: Message, reason: str) -> None:
        value = message.value if isinstance(message, SetControl) else None
        self._emit(
            Response.REFUSED, reason, id=message.id, user=message.user, subject=_subject(message), value=value
        )

    def _handle(self, message: Message) -> None:
        if isinstance(message, SetControl):
            before = self._value_of(message.control)
            settings = self._panel.set(self._settings, message.control, message.value)
            if message.trying:
                self._foresee(settings, message, before)
                return
            self._change(settings, message, message.control, message.value, before)
        elif message.action is Action.REVERT:
            name = str(self._actions.values_of(message)["control"])
            before = None if name == EVERYTHING else self._value_of(name)
            self._change(self._panel.revert(self._settings, name), message, name, None, before)
        elif message.action is Action.SAVE:
            self._save(message)
        else:
            self._restart(message)

    def _value_of(self, control: str) -> Value | None:
        found = [item.value for item in self.state().controls if item.name == control]
        return found[0] if found else None

    def _change(
        self, settings: Settings, message: Message, name: str, value: Value | None, before: Value | None
    ) -> None:
        """Check new settings, hand them to the walk, and tell what they do."""
        checking = settings.driving != self._settings.driving
        known = self._check(settings).places if checking else self._known
        numbers = loop_numbers(settings)
        if value is None and name != EVERYTHING:
            value = next(item.value for item in self._panel.controls(settings) if item.name == name)
        text = _told(name, before, value)
        note = {"user": message.user, "subject": name, "before": before, "value": value, "text": text}
        table = table_document(settings.table) if settings.table != self._settings.table else None
        answer = self._loop.ask(
            {"command": "settings", "numbers": numbers.to_dict(), "table": table, "note": note}
        )
        effect = effect_of(self._numbers, numbers, self._panel.problem)
        self._settings, self._numbers, self._known = settings, numbers, known
        self._renew_state()
        self._emit(
            Response.APPLIED,
            text,
            tick=answer["tick"],
            id=message.id,
            user=message.user,
            subject=name,
            value=value,
            before=before,
            effect=effect,
        )
        if self._recorder is not None and table is not None:
            self._recorder.table(table, answer["tick"])
        if checking:
            self._warn(settings)

    def _check(self, settings: Settings) -> Checked:
        """Hold settings to the rules; those that have just been tried have been held to them."""
        if self._checked is None or self._checked[:2] != (settings, self._known):
            self._checked = (settings, self._known, check_settings(settings, self._known))
        checked = self._checked[2]
        reason = refusal(checked, self._known)
        if reason:
            raise MessageRefused(reason)
        return checked

    # ------------------------------------------------------------------ looking ahead

    def _new_forecaster(self) -> LoopProcess:
        return LoopProcess(
            "forecast", on_frame=lambda line: None, on_message=self._hear, on_end=lambda status: None
        )

    def _start_forecaster(self) -> None:
        self._forecaster.close()
        self._forecaster = self._new_forecaster()
        self._forecaster.start({"document": self._loaded.document, "numbers": self._numbers.to_dict()})

    def _foresee(self, settings: Settings, message: SetControl, before: Value | None) -> None:
        """Forecast new settings; the walk goes on as it does."""
        if not self._forecaster.alive:
            self._start_forecaster()
        moment = self._loop.ask({"command": "moment"})
        request = {
            "command": "forecast",
            "moment": moment["moment"],
            "numbers": loop_numbers(settings).to_dict(),
        }
        coming = self._forecaster.command(request, lambda answer: None)
        if settings.driving != self._settings.driving:  # held to the rules in the meantime
            self._check(settings)
        try:
            forecast = self._forecaster.answer(coming)["forecast"]
        except ParameterError as error:
            raise MessageRefused("no forecast: its process has died; try again, or apply at once") from error
        self._emit(
            Response.FORECAST,
            f"forecast of {_told(message.control, before, message.value)}: {forecast['text']}",
            tick=moment["tick"],
            id=message.id,
            user=message.user,
            subject=message.control,
            value=message.value,
            before=before,
            forecast=forecast,
        )

    def _warn(self, settings: Settings) -> None:
        """Tell what the check warns of since the last change."""
        found = warnings(settings)
        new = [text for place, text in found.items() if place not in self._warned]
        self._warned = found
        if new:
            self._emit(Response.NOTE, "the check warns", warnings=tuple(new))

    def _do_directly(self, message: DoAction) -> None:
        values = self._actions.values_of(message)
        command: dict[str, Any] = {"command": str(message.action)}
        text = str(message.action)
        if message.action is Action.PUSH:
            joint, torque, duration = str(values["joint"]), float(values["torque"]), float(values["duration"])
            command |= {
                "joint": self._actions.joint_names.index(joint),
                "torque": torque,
                "ticks": ticks(duration),
            }
            text = f"push {joint}: {torque:g} Nm for {duration:g} s"
        elif message.action is Action.FAULT:
            command["fault"] = str(self._actions.fault_of(values))
            text = f"fault {command['fault'].partition('@')[0]}"
        command["note"] = {"user": message.user, "subject": str(message.action), "text": text}
        self._loop.command(command, lambda answer: self._tell_answer(message, text, answer))

    def _restart(self, message: DoAction) -> None:
        note = {"user": message.user, "subject": str(message.action), "text": "a new walk"}
        answer = self._loop.ask({"command": "restart", "note": note})
        self._tell_answer(message, "a new walk from the start", answer)

    def _tell_answer(self, message: DoAction, text: str, answer: Mapping[str, Any]) -> None:
        if answer["refused"]:
            self._refuse(message, answer["refused"])
            return
        self._emit(
            Response.APPLIED,
            text,
            tick=answer["tick"],
            id=message.id,
            user=message.user,
            subject=_subject(message),
        )

    def _save(self, message: DoAction) -> None:
        """Write the table as YAML beside the run folder."""
        folder = self.folder
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ParameterError(f"{folder.parent}: cannot be written ({error.strerror})") from error
        document = table_document(self._settings.table)
        # Tables of an earlier session with this --out stay.
        names = (folder.with_name(f"{folder.name}-table-{number}.yaml") for number in itertools.count(1))
        path = write_new(names, dump_yaml({**document, "name": f"{self._settings.table.name}_live"}))
        self._saved.append(str(path))
        self._renew_state()
        self._emit(
            Response.APPLIED,
            f"saved {path}; run it with: {self._run_again(path)}",
            id=message.id,
            user=message.user,
            subject=_subject(message),
            value=str(path),
        )

    def _run_again(self, path: Path) -> str:
        """The command that runs a saved table as it walks now."""
        name, scenario = self._loaded.experiment.name, self._settings.experiment.scenario
        words = ["twin-gait simulate", name if name in presets() else "EXPERIMENT", f"--set table={path}"]
        if isinstance(scenario, TreadmillScenario) and scenario != self._loaded.experiment.scenario:
            words.append(f"--set scenario.belt_speed_km_per_h={scenario.belt_speed / KM_PER_H:.6g}")
            words.append(f"--set scenario.support.share={scenario.support.share:.6g}")
        return " ".join(words)

    @property
    def table(self) -> GaitTable:
        """The gait table as it is now, before scaling."""
        return self._settings.table

    # ------------------------------------------------------------------ what the process says

    def _note_frame(self, line: str) -> None:
        """Notice by the head of a frame what the walk does by itself; the rest is for the pages."""
        self._frame = LatestFrame(self._frame.number + 1, line)
        head = json.loads(line.partition(',"q":')[0] + "}")
        self._tick, status = head["tick"], head["status"]
        if status != self._status:
            before, self._status = self._status, status
            if status in ("held", "fell", "diverged") and before not in ("starting", "ended"):
                told = "; ".join([*(event["text"] for event in head["events"]), _ENDINGS[status]])
                self._emit(Response.NOTE, told, tick=self._tick)
        if self._recorder is not None and self._recorder.failure:
            lost, self._recorder = self._recorder.failure, None
            self._emit(Response.NOTE, f"the session is no longer recorded: {lost}")

    def _hear(self, message: Mapping[str, Any]) -> None:
        kind = message["kind"]
        if kind == "compiling" and self._on_compile is not None:
            self._on_compile()
        elif kind == "ready":
            self._ready.set()
        elif kind == "failed":
            self.failure = message["text"]
            self._ready.set()
        elif kind == "journal":
            self._walks.append(Path(message["folder"]))
            self._record_folders()
        elif kind == "unkept":
            self._emit(Response.NOTE, f"the walk is no longer kept: {message['text']}")
        elif kind == "writing":
            self._on_step(message["step"])
        elif kind == "folder":
            self._note_folder(message)
        elif kind == "trace":
            self._traces.append(Trace(message["first"], message["end"], message["columns"]))

    def _note_folder(self, message: Mapping[str, Any]) -> None:
        if message["failed"]:
            self.failure = message["failed"]
            self._emit(Response.NOTE, f"the run folder could not be written: {self.failure}")
            return
        self.folders.append(Path(message["folder"]))
        self.summary = dict(message["summary"])
        self._emit(Response.NOTE, f"the run is in {message['folder']}")
        self._record_folders()

    def _record_folders(self) -> None:
        """Record where the runs are, and where those to come will be: somebody may have to complete them."""
        if self._recorder is not None:
            written = [str(item) for item in self.folders]
            coming = [str(item) for item in self._walks if journal_of(item).exists()]
            self._recorder.folders([*written, *(item for item in coming if item not in written)])

    def _note_end(self, status: int) -> None:
        """The process is gone."""
        if not self._ready.is_set():
            self.failure = self.failure or "the process of the walk has ended unexpectedly"
            self._ready.set()
        elif status != 0:
            how = f"killed by signal {-status}" if status < 0 else f"exit status {status}"
            self.death = f"the process of the walk died at {self._tick * TICK:.1f} s ({how})"
            self._status = "died"
            self._emit(Response.NOTE, f"{self.death}; the walk is kept up to its last second")
            self._show_death()

    def _show_death(self) -> None:
        """Let the last frame tell the pages too."""
        if self._frame.text:
            frame = {**json.loads(self._frame.text), "status": self._status}
            self._frame = LatestFrame(self._frame.number + 1, dump(frame))

    # ------------------------------------------------------------------ events

    def _renew_state(self) -> None:
        problem = self._panel.problem
        with self._lock:
            self._state = State(
                serial=self._serial,
                experiment=self._loaded.experiment.name,
                phases=problem.table.phase_names,
                joints=tuple(problem.table.joints),
                sides=tuple(str(side) for side in problem.sides),
                controls=self._panel.controls(self._settings),
                actions=self._actions.specs(),
                saved=tuple(self._saved),
            )

    def _emit(self, response: Response, text: str, *, tick: int | None = None, **rest: Any) -> Event:
        with self._lock:
            self._serial += 1
            event = Event(
                serial=self._serial,
                response=response,
                text=text,
                tick=self._tick if tick is None else tick,
                **rest,
            )
            self._events.append(event)
            if self._state is not None:
                self._state = replace(self._state, serial=self._serial)
        if self._recorder is not None:
            self._recorder.event(event)
        return event


_ENDINGS = {
    "held": "the legs are held, the belt stops and the harness is locked; start again to walk",
    "fell": "the wearer fell; start again to walk",
    "diverged": "the simulation diverged; start again to walk",
}


def _replaces(later: Message, message: Message) -> bool:
    """Whether a later message makes this one pointless; a forecast does not keep a change from being made."""
    if not isinstance(later, SetControl) or not isinstance(message, SetControl):
        return False
    return later.control == message.control and (message.trying or not later.trying)


def _subject(message: Message) -> str:
    return message.control if isinstance(message, SetControl) else str(message.action)


def _told(name: str, before: Value | None, value: Value | None) -> str:
    if name == EVERYTHING:
        return "everything as it began"
    return f"{name}: {_shown(before)} → {_shown(value)}"


def _shown(value: Value | None) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value).lower() if value is not None else "?"
