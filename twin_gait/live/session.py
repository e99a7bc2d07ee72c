"""A live session as the server of the pages sees it: messages in, events, states and frames out.

The walk runs in a process of its own (:mod:`twin_gait.live.process`). Here a message of a page is
understood, held to the rules of the check in a thread of this process, and handed over as numbers; the walk
waits for none of it. Stop, pause and the other actions that need no check do not wait for one either.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from twin_gait.configuration.documents import dump_yaml, table_document
from twin_gait.configuration.experiments import LoadedExperiment
from twin_gait.exceptions import ParameterError, RunDirectoryError, TwinGaitError
from twin_gait.files import write_new
from twin_gait.live.can_link import CanLink
from twin_gait.live.controls import Actions
from twin_gait.live.journal import complete, summary_of
from twin_gait.live.news import EventBook, WalkNews
from twin_gait.live.protocol import DoAction, Message, SetControl, State, one_line
from twin_gait.live.session_records import SessionRecorder
from twin_gait.live.tuning import Tuning
from twin_gait.runs.folders import check_target, journal_of
from twin_gait.runs.record import RUN_DIRECTORY
from twin_gait.simulation.problem import ticks

# Actions that wait for changes that are being checked; others go straight to the walk.
CHECKED = ("revert", "save")


class LiveSession:
    """One live session; all methods may be called from any thread and none waits for the walk.

    Use it as a context manager: leaving it ends the walk and writes its run folder.

    Attributes:
        folder: Run folder of the first walk.
        user: Whose session it is.
        book: Events of the session.
        news: The process of the walk, and what is known of its walks.
        tuning: The settings.
        folders: Run folders that have been written, at the end.
        summary: Of the last walk, at the end; empty if it could not be written.
        failure: Why a run folder could not be written; empty if it could.
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
        self.folders, self.summary, self.failure = list[Path](), dict[str, Any](), ""
        self._loaded, self.user, self._records = loaded, user, records
        self._force, self._pictures, self._can, self._on_step = force, pictures, can, on_step
        self._link: CanLink | None = None
        self.book = EventBook()
        self.news = WalkNews(self.book, on_compile=on_compile)
        self.tuning = Tuning(loaded, self.news, self.book)
        self._actions = Actions(self.tuning.panel.problem)
        self._worker = ThreadPoolExecutor(1, "live worker")

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
        check_target(self.folder, RUN_DIRECTORY, force=self._force)
        document = self._loaded.document
        setup = {"document": document, "folder": str(self.folder), "force": self._force, "can": self._can}
        with contextlib.ExitStack() as undo:
            undo.callback(self._close_processes)
            self._begin(setup)
            undo.pop_all()
        self.news.ask({"command": "walk"})

    def _begin(self, setup: Mapping[str, Any]) -> None:
        """Start the process; while it gets ready, check what the session begins with."""
        if self._can is not None:
            self._link = CanLink(self._can, self.tuning.panel.problem, book=self.book, submit=self.submit)
            self.news.on_rows = self._link.take
        self.news.start(setup)
        self.tuning.check_first()
        self.news.ready.wait()
        if self.news.failure:
            raise ParameterError(self.news.failure)
        self._worker.submit(lambda: self.tuning.ahead)  # before the first forecast is asked for
        if self._records is not None:
            name = self._loaded.experiment.name
            self.book.recorder = SessionRecorder(
                self._records, user=self.user, experiment=name, document=setup["document"], folder=self.folder
            )

    def _close_processes(self) -> None:
        if self._link is not None:
            self._link.close()
        self.news.close()
        self._worker.shutdown(cancel_futures=True)

    def close(self) -> None:
        """End the walk, write the run folders, and close the record."""
        self._close_processes()
        try:
            if (journal := journal_of(self.folder)).exists():
                self.folders = complete(journal, pictures=self._pictures, on_step=self._on_step)
        except RunDirectoryError as error:
            self.failure = one_line(error)
            self.book.emit("note", f"the run folder could not be written: {self.failure}")
        for folder in self.folders:
            self.summary = summary_of(folder)
            self.book.emit("note", f"the run is in {folder}")
        if self.book.recorder is not None:
            self.book.recorder.close(self.news.status, self.book.tick, self.summary, self.folders)
            self.book.recorder = None

    # ------------------------------------------------------------------ what pages ask for

    def submit(self, message: Message) -> None:
        """Take a message of a page; an event tells what became of it."""
        if isinstance(message, DoAction) and message.action not in CHECKED:
            self._guarded(message, self._do_directly)
            return
        with contextlib.suppress(RuntimeError):  # it has been closed
            # What the work does not expect is an error of the program: it is printed, not lost.
            self._worker.submit(self._guarded, message, self._handle).add_done_callback(Future.result)

    def state(self) -> State:
        """The panel with its present values."""
        problem = self.tuning.panel.problem
        return State(
            experiment=self._loaded.experiment.name, phases=problem.table.phase_names,
            joints=tuple(problem.table.joints),
            controls=self.tuning.controls, actions=self._actions.specs,
        )  # fmt: skip

    # ------------------------------------------------------------------ working them off

    def _guarded(self, message: Message, handle: Callable[[Any], None]) -> None:
        try:
            handle(message)
        except TwinGaitError as error:
            value = getattr(message, "value", None)
            self.book.answer(message, "refused", one_line(error), value=value)

    def _handle(self, message: Message) -> None:
        if isinstance(message, SetControl):
            self.tuning.set(message)
        elif message.action == "revert":
            self.tuning.revert(message, str(self._actions.values_of(message)["control"]))
        else:
            self._save(message)

    def _do_directly(self, message: DoAction) -> None:
        values, name = self._actions.values_of(message), str(message.action)
        note = {"user": message.user, "subject": name, "text": name}
        command: dict[str, Any] = {"command": name, "note": note}
        if message.action == "push":
            joint, torque, duration = str(values["joint"]), float(values["torque"]), float(values["duration"])
            number = self._actions.joint_names.index(joint)
            command |= {"joint": number, "torque": torque, "ticks": ticks(duration)}
            note["text"] = f"push {joint}: {torque:g} Nm for {duration:g} s"
        elif message.action == "request":
            command["request"] = str(values["request"])
        elif message.action == "fault":
            command["fault"] = str(self._actions.fault_of(values))
            note["text"] = f"fault {command['fault'].partition('@')[0]}"

        def tell(answer: Mapping[str, Any]) -> None:
            text = answer.get("text", note["text"])
            self.book.answer(message, "applied", text, tick=answer["tick"])

        coming = self.news.command(command)
        coming.add_done_callback(
            lambda answered: self._guarded(message, lambda _: tell(self.news.answer(answered)))
        )

    def _save(self, message: DoAction) -> None:
        """Write the table as YAML beside the run folder."""
        table = self.tuning.settings.table
        # Tables of an earlier session with this --out stay.
        name = f"{self.folder.name}-table-"
        names = (self.folder.with_name(f"{name}{number}.yaml") for number in itertools.count(1))
        path = write_new(names, dump_yaml({**table_document(table), "name": f"{table.name}_live"}))
        text = f"saved {path}; run it with: twin-gait simulate EXPERIMENT --set table={path}"
        self.book.answer(message, "applied", text, value=str(path))
