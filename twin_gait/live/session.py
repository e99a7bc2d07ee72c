"""A live session as the server of the pages sees it: messages in, events, states and frames out.

The walk runs in a process of its own (:mod:`twin_gait.live.process`). Here a message of a page is
understood, held to the rules of the check in a thread of this process, and handed over as numbers; the walk
waits for none of it. Stop, pause and the other actions that need no check do not wait for one either.
"""

from __future__ import annotations

import contextlib
import itertools
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from twin_gait.configuration.documents import dump_yaml, table_document
from twin_gait.configuration.experiments import LoadedExperiment, presets
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.files import write_new
from twin_gait.gait.table import GaitTable
from twin_gait.live.can_link import CanLink
from twin_gait.live.controls import Actions
from twin_gait.live.journal import complete, complete_all
from twin_gait.live.news import EventBook, WalkNews
from twin_gait.live.protocol import Action, DoAction, Message, Response, SetControl, State
from twin_gait.live.session_records import SessionRecorder
from twin_gait.live.tuning import Tuning
from twin_gait.runs.folders import check_target, journal_of
from twin_gait.runs.record import RUN_DIRECTORY
from twin_gait.simulation.problem import ticks

# Actions that go straight to the walk, whatever is being checked meanwhile.
DIRECT = frozenset(Action) - {Action.REVERT, Action.SAVE, Action.RESTART}


class LiveSession:
    """One live session; all methods may be called from any thread and none waits for the walk.

    Use it as a context manager: leaving it ends the walk and writes its run folder.

    Attributes:
        folder: Run folder of the first walk.
        book: Events of the session.
        news: The process of the walk, and what is known of its walks: how they stand, where they are.
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
        can: str | None = None,
        on_compile: Callable[[], None] = lambda: None,
        on_step: Callable[[str], None] = lambda name: None,
    ) -> None:
        """Prepare the session; :meth:`start` starts the process.

        ``loaded``: experiment; its duration is the longest time of a walk; ``force``: whether an existing run
        folder may be replaced; ``pictures``: whether to draw figures and animation at the end; ``records``:
        folder of the record of sessions, or None to keep no record; ``can``: bus that the walk is put on, as
        :func:`~twin_gait.live.can_link.open_bus` takes it; None for none; ``on_compile``: called if the walk
        has to be compiled first, which takes 10 to 20 s; ``on_step``: called at the end with the name of each
        file before it is written.
        """
        self.folder = Path(folder).expanduser().absolute()
        self._loaded, self._user, self._records = loaded, user, records
        self._setup = {
            "document": loaded.document, "folder": str(self.folder), "force": force, "pictures": pictures,
            "can": can,
        }  # fmt: skip
        self._link: CanLink | None = None
        self.book = EventBook()
        self.news = WalkNews(self.book, on_compile=on_compile, on_step=on_step)
        self._tuning = Tuning(loaded, self.news, self.book)
        self._actions = Actions(self._tuning.problem)
        self._action_specs = self._actions.specs()
        self._saved: list[str] = []
        self._queue: deque[Message] = deque()
        self._worker, self._closed = ThreadPoolExecutor(1, "live worker"), False

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

        Raises RunDirectoryError if the run folder may not be used. Raises ParameterError if the experiment
        cannot be walked live, or the bus cannot be opened. Raises MissingOptionalDependency if a bus is asked
        for without python-can.
        """
        if journal_of(self.folder).exists():  # of an earlier session that was killed
            complete(journal_of(self.folder))
        check_target(self.folder, RUN_DIRECTORY, force=bool(self._setup["force"]))
        if self._setup["can"] is not None:
            self._link = CanLink(
                str(self._setup["can"]), self._tuning.problem, book=self.book, submit=self.submit,
                controls=lambda: self._tuning.controls,
            )  # fmt: skip
            self.news.on_rows = self._link.take
        try:
            self._begin()
        except BaseException:
            self._close_processes()
            raise
        if self._link is not None:
            self._link.start()
        self.news.ask({"command": "walk"})

    def _begin(self) -> None:
        """Start the process; while it gets ready, check what the session begins with."""
        self.news.start(self._setup)
        self._tuning.check_first()
        self.news.ready.wait()
        if self.news.failure:
            raise ParameterError(self.news.failure)
        self._tuning.start_forecaster()
        if self._records is not None:
            name, document = self._loaded.experiment.name, self._loaded.document
            self.book.recorder = SessionRecorder(
                self._records, user=self._user, experiment=name, document=document
            )
            self._tuning.record_table(0)
            self.news.record_folders()

    def _close_processes(self) -> None:
        if self._link is not None:
            self._link.close()
        self.news.close()
        self._worker.shutdown(cancel_futures=True)
        self._tuning.close()

    def close(self) -> dict[str, Any]:
        """End the walk, wait until its run folder is written, and close the record.

        Returns the summary of the last walk; empty if it could not be written, and ``news.failure`` says why.
        """
        if self._closed:
            return self.news.summary
        self._closed = True
        self._close_processes()
        # Those that the process left behind.
        complete_all(map(journal_of, self.news.walks), self.news.hear, pictures=True)
        if self.book.recorder is not None:
            folders = [str(item) for item in self.news.folders]
            self.book.recorder.close(self.news.status, self.book.tick, self.news.summary, folders)
        return self.news.summary

    # ------------------------------------------------------------------ what pages ask for

    def submit(self, message: Message) -> None:
        """Take a message of a page; an event tells what became of it."""
        if isinstance(message, DoAction) and message.action in DIRECT:
            self._guarded(message, self._do_directly)
            return
        self._queue.append(message)
        with contextlib.suppress(RuntimeError):  # it has been closed
            # What the work does not expect is an error of the program: it is printed, not lost.
            self._worker.submit(self._work_off).add_done_callback(Future.result)

    def state(self) -> State:
        """The panel with its present values."""
        problem = self._tuning.problem
        return State(
            serial=self.book.serial, experiment=self._loaded.experiment.name,
            phases=problem.table.phase_names, joints=tuple(problem.table.joints),
            sides=tuple(str(side) for side in problem.sides), controls=self._tuning.controls,
            actions=self._action_specs, saved=tuple(self._saved),
        )  # fmt: skip

    @property
    def table(self) -> GaitTable:
        """The gait table as it is now, before scaling."""
        return self._tuning.settings.table

    # ------------------------------------------------------------------ working them off

    def _work_off(self) -> None:
        message = self._queue.popleft()
        if any(_replaces(later, message) for later in tuple(self._queue)):
            self.book.answer(message, Response.REFUSED, "overtaken by a newer value")
        else:
            self._guarded(message, self._handle)

    def _guarded(self, message: Message, handle: Callable[[Any], None]) -> None:
        try:
            handle(message)
        except TwinGaitError as error:
            reason = " ".join(str(error).split())
            self.book.answer(message, Response.REFUSED, reason, value=getattr(message, "value", None))

    def _handle(self, message: Message) -> None:
        if isinstance(message, SetControl):
            self._tuning.set(message)
        elif message.action is Action.REVERT:
            self._tuning.revert(message, str(self._actions.values_of(message)["control"]))
        elif message.action is Action.SAVE:
            self._save(message)
        else:
            note = {"user": message.user, "subject": str(message.action), "text": "a new walk"}
            answer = self.news.ask({"command": "restart", "note": note})
            self._tell_applied(message, "a new walk from the start", answer)

    def _do_directly(self, message: DoAction) -> None:
        values, text = self._actions.values_of(message), str(message.action)
        command: dict[str, Any] = {"command": str(message.action)}
        if message.action is Action.PUSH:
            joint, torque, duration = str(values["joint"]), float(values["torque"]), float(values["duration"])
            number = self._actions.joint_names.index(joint)
            command |= {"joint": number, "torque": torque, "ticks": ticks(duration)}
            text = f"push {joint}: {torque:g} Nm for {duration:g} s"
        elif message.action is Action.REQUEST:
            command["request"] = text = str(values["request"])
        elif message.action is Action.FAULT:
            command["fault"] = str(self._actions.fault_of(values))
            text = f"fault {command['fault'].partition('@')[0]}"
        command["note"] = {"user": message.user, "subject": str(message.action), "text": text}
        self.news.command(command).add_done_callback(
            lambda answered: self._guarded(
                message, lambda message: self._tell_applied(message, text, self.news.answer(answered))
            )
        )

    def _tell_applied(self, message: DoAction, text: str, answer: Mapping[str, Any]) -> None:
        self.book.answer(message, Response.APPLIED, answer.get("text", text), tick=answer["tick"])

    def _save(self, message: DoAction) -> None:
        """Write the table as YAML beside the run folder."""
        folder = self.folder
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ParameterError(f"{folder.parent}: cannot be written ({error.strerror})") from error
        document = table_document(self.table)
        # Tables of an earlier session with this --out stay.
        names = (folder.with_name(f"{folder.name}-table-{number}.yaml") for number in itertools.count(1))
        path = write_new(names, dump_yaml({**document, "name": f"{self.table.name}_live"}))
        self._saved.append(str(path))
        text = f"saved {path}; run it with: {self._run_again(path)}"
        self.book.answer(message, Response.APPLIED, text, value=str(path))

    def _run_again(self, path: Path) -> str:
        """The command that runs a saved table as it walks now."""
        name, scenario = self._loaded.experiment.name, self._tuning.settings.experiment.scenario
        words = ["twin-gait simulate", name if name in presets() else "EXPERIMENT", f"--set table={path}"]
        if scenario != self._loaded.experiment.scenario:
            words += [f"--set scenario.{item.key}={item.shown:.6g}" for item in scenario.adjustments]
        return " ".join(words)


def _replaces(later: Message, message: Message) -> bool:
    """Whether a later message makes this one pointless; a forecast does not keep a change from being made."""
    if not isinstance(later, SetControl) or not isinstance(message, SetControl):
        return False
    return later.control == message.control and (message.kind == "try" or later.kind == "set")
