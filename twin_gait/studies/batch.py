"""Many episodes of one experiment, each with a few values of its own, as one table.

Memory does not grow with the length of a batch but for the rows of its table (6 to 11 kB each, measured over
2500 episodes on the bench and 350 on the treadmill). A log lives until its row is made, and holds only the
columns that the row is made of.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.experiment_file import Converted, experiment_from_mapping
from twin_gait.configuration.overrides import assign, parse_assignment
from twin_gait.configuration.people import names_a_person, person_document
from twin_gait.configuration.validation import converting
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment import Experiment
from twin_gait.runs.summary import READ_IN_BRIEF, summarise_in_brief
from twin_gait.simulation import Run, RunStatus
from twin_gait.studies.episodes import run_episodes
from twin_gait.studies.jobs import JobFailed, Workers
from twin_gait.vocabulary import JointName, Side

# Keys of an experiment document joined by dots, such as ``patient.mass_kg``, with their new values.
Override = Mapping[str, Any]
Flat = dict[str, float | str | bool | None]

RUN_COLUMNS = (
    "status",
    "outcome",
    "fell",
    "seed",
    "duration_s",
    "battery_power_mean_W",
    "battery_power_peak_W",
    "battery_energy_J",
    "energy_residual_share",
)
SIDE_COLUMNS = (
    "strides",
    "strides_counted",
    "stride_time_mean_s",
    "stride_time_variation",
    "swing_share",
    "rmse_hip_by_contact_deg",
    "rmse_knee_by_contact_deg",
    "early_stance_lag_mean_s",
    "toe_clearance_mean_m",
    "toe_clearance_least_m",
    "further_contacts",
    "scuffs",
    "strides_by_phase",
    "phases_in_order",
    "time_outs",
)
JOINT_COLUMNS = (
    "range_of_motion_deg",
    "saturated_share",
    "torque_peak_Nm",
    "torque_rms_Nm",
    "torque_continuous_share",
)
# Every column that a summary can have, in order; a table has those of the legs that its episodes have.
SUMMARY_COLUMNS = (
    *RUN_COLUMNS,
    *(
        name
        for side in Side
        for name in (
            *(f"{side}_{name}" for name in SIDE_COLUMNS),
            *(f"{side}_{joint}_{name}" for joint in JointName for name in JOINT_COLUMNS),
        )
    ),
)
_TEXTS = frozenset({"status", "outcome"})
_TRUTHS = frozenset({"fell", "phases_in_order"})
_COUNTS = frozenset(
    {"strides", "strides_counted", "further_contacts", "scuffs", "strides_by_phase", "time_outs"}
)


@dataclass(frozen=True)
class BatchResult:
    """What a batch gives back.

    Attributes:
        table: One row per episode in the order of the overrides: ``episode``, the overridden keys, then the
            columns of :func:`flat_summary`. A key that only other episodes override is empty. A key that a
            column of the summary is also called, such as ``duration_s``, has ``set.`` in front.
        status: ``COMPLETED``, or ``INTERRUPTED`` if the batch was stopped; then the table holds the first
            episodes only.
    """

    table: pd.DataFrame
    status: RunStatus


class _Episode(NamedTuple):
    number: int
    override: Override

    def __str__(self) -> str:
        return f"episode {self.number}"


def simulate_batch(
    experiment: Experiment,
    overrides: Sequence[Override],
    *,
    workers: int | Workers = 1,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> BatchResult:
    """Simulate one experiment once for each set of changes.

    All changes are checked before anything runs. The result does not depend on the number of workers or on
    the order in which they finish. With several workers a script must guard its own code, see
    :func:`twin_gait.studies.run_jobs`.

    Args:
        experiment: What all episodes have in common.
        overrides: What each changes.
        workers: Processes, or :class:`~twin_gait.studies.Workers`.
        progress: Called with episodes done and in all.
        should_stop: Asked now and then; True lets those that run finish and ends the batch.

    Returns:
        The table and whether the batch was stopped.

    Raises:
        WorkersLost: If worker processes die again and again with the same episode.
        ParameterFileError: If a change is wrong, naming episode and key, or if an episode cannot be run.
        ParameterError: If the workers make no sense.
    """
    base = Base.of(experiment)
    episodes = [_Episode(index, override) for index, override in enumerate(overrides)]
    for episode in episodes:
        _experiment_of(base, episode)
    try:
        rows = run_episodes(
            partial(_experiment_of, base),
            flat_summary,
            episodes,
            columns=READ_IN_BRIEF,
            workers=workers,
            progress=progress,
            should_stop=should_stop,
        )
    except JobFailed as error:
        raise ParameterFileError(f"episode {error.index}", "", error.problem) from error
    status = RunStatus.INTERRUPTED if len(rows) < len(overrides) else RunStatus.COMPLETED
    return BatchResult(_table(rows, overrides), status)


class Base(NamedTuple):
    """An experiment with its document, which takes longer to write than to change.

    Attributes:
        experiment: The experiment.
        document: Its mapping.
    """

    experiment: Experiment
    document: dict[str, Any]

    @classmethod
    def of(cls, experiment: Experiment) -> Base:
        """Write the document."""
        return cls(experiment, experiment_document(experiment))

    def changed(self, override: Override, source: str) -> Experiment:
        """See :func:`overridden`."""
        document = self.document
        for key, value in override.items():
            plain = value.item() if isinstance(value, np.generic) else value
            if key == "patient" and names_a_person(plain):
                plain = converting(source, "patient", partial(person_document, plain))
                document = {**document, "patient": None}  # nothing of the one before is left underneath
            document = _assigned(document, key, plain, source)
        like = Converted(self.document, self.experiment)
        return experiment_from_mapping(document, source, Path(), like)


def overridden(experiment: Experiment, override: Override, source: str = "override") -> Experiment:
    """The experiment with some values changed, as ``--set`` changes them.

    Args:
        experiment: The experiment.
        override: Values by keys of its document, joined by dots, list positions in brackets; a quantity may
            be given in any unit that its file may. A mapping is laid over what is there. A ``patient`` may be
            exchanged by name; the gait table is changed below ``table.``, not exchanged by name.
        source: What messages begin with.

    Returns:
        The changed experiment.

    Raises:
        ParameterFileError: If there is no such key, or the value is wrong.
    """
    return Base.of(experiment).changed(override, source)


def flat_summary(run: Run) -> Flat:
    """Sum a run up in one row.

    The values are those of :func:`twin_gait.runs.summary.summarise` under the same names, with
    side and joint in front: ``left_stride_time_mean_s``, ``left_knee_saturated_share``. Nothing in it depends
    on the machine's speed.

    Returns:
        ``RUN_COLUMNS``, then ``SIDE_COLUMNS`` of every leg and ``JOINT_COLUMNS`` of every joint of it; None
        where a number is not defined.
    """
    whole = summarise_in_brief(run)
    flat: Flat = {name: whole[name] for name in RUN_COLUMNS}
    for side, values in whole["sides"].items():
        flat |= {f"{side}_{name}": values.get(name) for name in SIDE_COLUMNS}
        for joint, effort in values["joints"].items():
            flat |= {f"{side}_{joint}_{name}": effort[name] for name in JOINT_COLUMNS}
    return flat


def _experiment_of(base: Base, episode: _Episode) -> Experiment:
    return base.changed(episode.override, str(episode))


def _assigned(document: dict[str, Any], key: str, value: Any, source: str) -> dict[str, Any]:
    """A document with one value changed; what is wrong with the key is told with its name."""
    try:
        path, rest = parse_assignment(f"{key}=")
        if rest is None:
            return assign(document, path, value)
    except ParameterError as error:
        raise ParameterFileError(source, str(key), "there is no such place; join names by dots") from error
    raise ParameterFileError(source, str(key), "expected a key and its value apart, not an assignment")


def _table(rows: Sequence[Flat], overrides: Sequence[Override]) -> pd.DataFrame:
    names = setting_columns(key for row in overrides for key in row)
    changes = [
        {"episode": index, **{names[key]: value for key, value in overrides[index].items()}}
        for index in range(len(rows))
    ]
    settings = pd.DataFrame(changes, columns=["episode", *names.values()]).astype({"episode": int})
    return pd.concat([settings, summary_table(rows)], axis=1)


def setting_columns(keys: Iterable[str]) -> dict[str, str]:
    """Names of the columns of overridden keys.

    Returns:
        Name by key, in the order of their first appearance: the key, with ``set.`` in front where a column
        of the summary is called so.
    """
    return {key: f"set.{key}" if key in RUN_COLUMNS else key for key in keys}


def summary_table(rows: Sequence[Flat]) -> pd.DataFrame:
    """Flat summaries as a table whose order and types of columns do not depend on the values.

    Returns:
        One row each; a column that an episode does not have, such as one of a missing leg, is empty there.
    """
    found = {name for row in rows for name in row}
    names = [name for name in SUMMARY_COLUMNS if name in found]
    return pd.DataFrame(rows, columns=names).astype({name: _column_type(name) for name in names})


def _column_type(column: str) -> str:
    name = column.split("_", 1)[-1] if column.startswith(("left_", "right_")) else column
    if name in _TEXTS:
        return "object"
    if name in _TRUTHS:
        return "bool" if column in RUN_COLUMNS else "boolean"
    return "Int64" if name in _COUNTS else "UInt64" if name == "seed" else "float64"
