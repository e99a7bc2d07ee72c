"""Many episodes of one experiment, each with a few values of its own, as one table.

Memory grows with the length of a batch by the rows of its table (6–11 kB each, measured over 2500 episodes on
the bench and 350 on the treadmill) and by its experiments (3 kB each with three values of their own). A log
exists until its row is computed, and contains only the columns that the row needs.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Unpack

import numpy as np
import pandas as pd

from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.experiments import (
    FILE_KEYS,
    LoadedExperiment,
    experiment_from_mapping,
    load_named_document,
    replace_device,
    sections_of_person,
)
from twin_gait.configuration.policy_file import read_policy
from twin_gait.configuration.validation import (
    assign,
    convert_with_context,
    parse_path,
    reject_duplicate_units,
)
from twin_gait.exceptions import JobError, ParameterError, ParameterFileError, TwinGaitError
from twin_gait.experiment.experiment import Experiment
from twin_gait.files import to_json_value
from twin_gait.measures.walk import WALK_COLUMNS
from twin_gait.parameters.wearer import Patient
from twin_gait.runs.leg_summary import MeasuredLeg, saturated_shares
from twin_gait.runs.summary import battery_summary, energy_summary
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulator import precompile, simulate_blocks
from twin_gait.studies.jobs import WorkCallbacks, run_blocks
from twin_gait.studies.workers import Item, Result, Workers
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.world import Walking
from twin_gait.yaml12 import load_data


def run_episodes(
    experiment_of: Callable[[Item], Experiment],
    measure: Callable[[Run], Result],
    items: Sequence[Item],
    *,
    columns: tuple[str, ...] | None = None,
    block: int | None = None,
    workers: int | Workers = 1,
    on_results: Callable[[dict[int, Result]], None] | None = None,
    episode_name: Callable[[int], str] = "episode {}".format,
    **watch: Unpack[WorkCallbacks],
) -> list[Result]:
    """Simulate the experiment of each item and measure the run; its log is then discarded.

    Results, ``workers`` and ``watch`` are those of :func:`twin_gait.studies.jobs.run_jobs`. An episode that
    cannot be simulated is a ParameterError.

    Args:
        experiment_of: Function that creates the experiment of an item; it is sent to the workers, as are
            ``measure`` and the items.
        measure: Function that returns the result of a run.
        items: Arguments of ``experiment_of``.
        columns: Columns of a log that ``measure`` reads, as in
            :func:`~twin_gait.simulation.simulator.simulate_blocks`; all by default.
        block: Number of episodes in a block, for which the caller has compiled; by default chosen for speed.
        on_results: Receives the results of each block, see :func:`twin_gait.studies.jobs.run_blocks`.
        episode_name: Function that returns the name of an episode in errors, from its number.
    """
    if block is None:
        block = _choose_block_size(experiment_of, items, watch.get("on_compile"))
    walk = partial(_measured, experiment_of, measure, columns)
    try:
        return run_blocks(walk, items, block=block, workers=workers, on_results=on_results, **watch)
    except JobError as error:
        raise ParameterError(f"{episode_name(error.index)}: {error.problem}") from error


def identity(experiment: Experiment) -> Experiment:
    """Return an experiment as it is, for items that are experiments."""
    return experiment


def _measured(
    experiment_of: Callable[[Item], Experiment],
    measure: Callable[[Run], Result],
    columns: tuple[str, ...] | None,
    items: Sequence[Item],
) -> Iterator[tuple[int, Result]]:
    for index, run in simulate_blocks(map(experiment_of, items), columns=columns):
        yield index, measure(run)


def _choose_block_size(
    experiment_of: Callable[[Item], Experiment], items: Sequence[Item], on_compile: Callable[[], None] | None
) -> int:
    """Compile before the workers need the code, and return the number of episodes in a block."""
    if items:
        with suppress(TwinGaitError):  # a mistake is reported when its episode is run
            return precompile(experiment_of(items[0]), len(items), on_compile)
    return 1


def walking_wearer(experiment: Experiment) -> tuple[Walking, Patient]:
    """Return the walking scenario of an experiment and its wearer; raise ParameterError if one is missing."""
    walking, patient = experiment.scenario.walking, experiment.patient
    if walking is None or patient is None:
        raise ParameterError(
            f"{experiment.name}: expected a wearer who walks on the ground; choose such a preset, and a "
            "person with --patient"
        )
    return walking, patient


# New values by key of an experiment document, joined by dots, such as ``patient.mass_kg``.
Override = Mapping[str, Any]
FlatSummary = dict[str, float | str | bool | None]
# Keys whose values may be names of entities that are replaced as a whole.
REPLACEABLE_KEYS = ("device", "patient", "table", "scenario")
# Meaning of names, by key and name_of: mappings of an experiment document; paths under FILES.
FILES = "files"
Named = Mapping[str, Mapping[str, Any]]

# Endings of the log columns that :func:`flat_summary` reads, in addition to time and phases.
SUMMARY_LOG_COLUMNS = (
    "_motor_command_torque_Nm", "_motor_torque_Nm", "_target_current_A", "_measured_current_A",
    "_foot_normal_force_N", "_foot_clearance_m", "battery_power_W", "kinetic_energy_J", "potential_energy_J",
    "_work_J", *WALK_COLUMNS,
)  # fmt: skip

_COLUMNS = load_data(Path(__file__).with_name("summary_columns.yaml"))
_RUN, _SIDE, _JOINT = _COLUMNS["run"], _COLUMNS["leg"], _COLUMNS["joint"]
_TYPES = dict(_RUN)
for _side in Side:
    _TYPES |= {f"{_side}_{name}": kind for name, kind in _SIDE.items()}
    _TYPES |= {f"{_side}_{joint}_{name}": kind for joint in JointName for name, kind in _JOINT.items()}
# All columns that a summary can have, in order; a table contains those of the legs of its episodes.
SUMMARY_COLUMNS = tuple(_TYPES)


def simulate_batch(
    experiment: Experiment,
    overrides: Sequence[Override],
    *,
    workers: int | Workers = 1,
    **watch: Unpack[WorkCallbacks],
) -> pd.DataFrame:
    """Simulate one experiment once for each set of changes.

    All changes are checked before anything runs. The result does not depend on the number of workers or on
    the order in which they finish. With several workers a script must guard its own code, see
    :func:`twin_gait.studies.jobs.run_jobs`, which also describes ``watch``.

    Returns a table with a row for each episode in their order, of the first ones only if the work was
    stopped; its columns are those of :func:`results_table`. Raises WorkersLost if a worker process dies.
    Raises ParameterFileError if a change is wrong, naming episode and key. Raises ParameterError if an
    episode cannot be simulated, or the number of workers is invalid.
    """
    base = attach_document(experiment)
    experiments = [
        apply_override(base, override, f"episode {index}") for index, override in enumerate(overrides)
    ]
    rows = run_episodes(
        identity, flat_summary, experiments, columns=SUMMARY_LOG_COLUMNS, workers=workers, **watch
    )
    return results_table(overrides, summary_table(rows))


def value_to_text(value: Any) -> str:
    """Return a value as text; a value that is no text, such as a person with changes, as JSON."""
    return value if isinstance(value, str) else json.dumps(value, default=str)


def attach_document(experiment: Experiment) -> LoadedExperiment:
    """Return an experiment with its document, which takes longer to write than to change."""
    return LoadedExperiment(experiment, experiment_document(experiment))


class NamedFile(NamedTuple):
    """File that an override names."""

    section: str  # section of the experiment document
    given: str  # path or name


def named_file(key: str, value: Any) -> NamedFile | None:
    """Return the file that a value of an override names, or None if it names none."""
    section, _, rest = key.partition(".")
    name = FILE_KEYS.get(section, "")
    given = value if rest == name else value.get(name) if not rest and isinstance(value, Mapping) else None
    return NamedFile(section, given) if name and isinstance(given, str) else None


def apply_override(
    base: LoadedExperiment, override: Override, source: str = "override", known: Named = MappingProxyType({})
) -> Experiment:
    """Return the experiment with some values changed, for many changes of one experiment.

    The arguments are those of :func:`override_experiment`, in addition ``source``, the name of the override
    in errors, and ``known``, the meaning of names.
    """
    document = base.document
    convert_with_context(source, "", lambda: reject_duplicate_units(override))
    for key, value in sorted(override.items(), key=lambda item: item[0] not in REPLACEABLE_KEYS):
        plain = value.item() if isinstance(value, np.generic) else value
        if key in REPLACEABLE_KEYS:
            named = known.get(key, {}).get(value_to_text(plain)) or load_named_document(
                key, plain, Path(source)
            )
            if named is not None and key == "device":
                document = replace_device(document, named)
                continue
            if named is not None and key == "patient":
                sections = sections_of_person(named)
                document, named = {**document, **sections}, sections["patient"]
            if named is not None:
                document, plain = {**document, key: None}, named  # nothing of the former value remains
        if (file := named_file(key, plain)) is not None:
            path = known.get(FILES, {}).get(file.given, file.given)
            plain = path if isinstance(plain, str) else {**plain, FILE_KEYS[file.section]: path}
        if key == "control.policy" and isinstance(plain, str):
            plain = read_policy(plain, Path(source))
        document = _assigned(document, key, plain, source)
    return experiment_from_mapping(document, source, Path(), base)


def override_experiment(experiment: Experiment, override: Override) -> Experiment:
    """Return the experiment with some values changed, as ``--set`` changes them.

    ``override``: values by keys of its document, joined by dots, list positions in brackets; a quantity may
    be given in any unit that its file accepts. A mapping is merged into the existing one. ``device``,
    ``patient``, ``table`` and ``scenario`` may be replaced by name or path; other keys are then applied to
    the new ones.
    """
    return apply_override(attach_document(experiment), override)


def flat_summary(run: Run) -> FlatSummary:
    """Summarise a run in one row: numbers of the run, of each leg, and of each joint.

    The values are those of :func:`twin_gait.runs.summary.summarise_run` under the same names, prefixed by
    side and joint: ``left_stride_time_mean_s``, ``left_knee_saturated_share``, ``left_load_peak``. Parts of
    the error are named like ``left_hip_error_total_deg``, those of ``power`` like ``power_belt_W``, and the
    trip has ``trip_cause``, ``trip_location`` and ``trip_time_s``. A value is None if it is not defined. No
    value depends on the speed of the machine. The log must contain the columns ``SUMMARY_LOG_COLUMNS``; an
    external torque without a column is zero.
    """
    trip, walk = run.trip, run.walk_measures()
    legs = [MeasuredLeg(run, record) for record in run.leg_records()]
    power = run.walk_power(legs=walk) or {}
    whole = {
        **{"status": run.status, "outcome": run.verdict.outcome, "fell": run.status is RunStatus.FELL},
        **{"seed": run.experiment.seed, "duration_s": run.duration},
        **battery_summary(run),
        **energy_summary(run),
        **saturated_shares(legs),
        **{f"power_{name}": value for name, value in power.items()},
        **({} if trip is None else {"trip_cause": str(trip.cause), "trip_location": trip.location}),
        **({} if trip is None else {"trip_time_s": trip.time}),
    }
    flat = {name: whole.get(name) for name in _RUN}
    for leg in legs:
        side = leg.record.side
        errors = leg.error_parts().get("errors", {})
        values = {**leg.brief_summary(), **walk.get(side, {})}
        for joint, parts in errors.items():
            values |= {f"{joint}_error_{part}": value for part, value in parts.items()}
        flat |= {f"{side}_{name}": values.get(name) for name in _SIDE}
        for joint, effort in values["joints"].items():
            flat |= {f"{side}_{joint}_{name}": effort[name] for name in _JOINT}
    found: FlatSummary = to_json_value(flat)
    return found


def _assigned(document: dict[str, Any], key: str, value: Any, source: str) -> dict[str, Any]:
    """Return a document with one value changed; an error in the key names it."""
    name, separator, _ = str(key).partition("=")
    path = convert_with_context(source, str(key), lambda: parse_path(name, f"{key}="))
    if separator:
        raise ParameterFileError(source, str(key), "expected a key and a value, got an assignment")
    assigned: dict[str, Any] = convert_with_context(source, str(key), lambda: assign(document, path, value))
    return assigned


def settings_table(overrides: Sequence[Override]) -> pd.DataFrame:
    """Return the changes of each episode as a table.

    The types of its columns do not depend on the number of finished episodes. A column has the name of its
    key, prefixed by ``set.`` if the summary has a column of this name, such as ``duration_s``. Values without
    a type of their own are written as JSON; a key that an episode does not change is empty.
    """
    keys = dict.fromkeys(key for override in overrides for key in override)
    settings = pd.DataFrame(overrides, columns=list(keys), index=range(len(overrides)), dtype=object)
    settings = settings.infer_objects()
    mixed = settings.columns[settings.dtypes == np.dtype(object)]
    settings[mixed] = settings[mixed].map(value_to_text, na_action="ignore")
    return settings.rename(columns={key: f"set.{key}" for key in keys if key in _RUN})


def results_table(overrides: Sequence[Override], rows: pd.DataFrame) -> pd.DataFrame:
    """Return ``episode``, settings and summary of the episodes in a table of summaries, by its index."""
    settings = settings_table(overrides).loc[rows.index]
    results = rows[[name for name in SUMMARY_COLUMNS if name in rows]]
    return pd.concat([settings, results], axis=1).rename_axis("episode").reset_index()


def summary_table(rows: Sequence[FlatSummary]) -> pd.DataFrame:
    """Convert flat summaries to a table whose order and types of columns do not depend on the values.

    A column that an episode lacks, such as one of a missing leg, is empty in its row.
    """
    found = {name for row in rows for name in row}
    types = {name: kind for name, kind in _TYPES.items() if name in found}
    return pd.DataFrame(rows, columns=list(types)).astype(types).copy()  # many columns in few blocks
