"""Identification of friction: reading of logs, choice and fit of models, their order and warnings."""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from twin_gait.exceptions import ParameterError
from twin_gait.identification import statistics
from twin_gait.identification.current_delay import delay_warnings
from twin_gait.identification.fitting import Fit, FitOptions, Loss, fit_model
from twin_gait.identification.laws import MODELS, OFFSET
from twin_gait.identification.models import FrictionModel, FrictionTest, Samples, join_tests, thinned
from twin_gait.identification.processing import BenchSetup, Processing, balance_warnings, process_log
from twin_gait.identification.reading import ColumnOptions, read_log
from twin_gait.identification.statistics import CrossValidation, Goodness, Uncertainty

MIN_DIRECTION_SHARE = 0.02  # share of the samples below which a direction was not measured


def find_models(names: tuple[str, ...]) -> tuple[FrictionModel, ...]:
    """Look up models by their names, in their order, or all models without names.

    Raises ParameterError for an unknown name.
    """
    for name in names:
        if name not in MODELS:
            raise ParameterError(f"model: expected one of {', '.join(MODELS)}, got {name!r}")
    return tuple(MODELS[name] for name in dict.fromkeys(names)) if names else tuple(MODELS.values())


def _lacking(model: FrictionModel, samples: Samples) -> tuple[str, ...]:
    """Return the needs of a model that the samples do not meet: columns that vary, motion both ways."""
    columns = {name: getattr(samples, name) for name in model.needs}
    lacking = [name for name, values in columns.items() if values is None or np.ptp(values) <= 1e-9]
    # Motion in one direction only: an offset cannot be distinguished from Coulomb friction.
    if OFFSET in model.coefficients and samples.rarer_direction < MIN_DIRECTION_SHARE:
        lacking.append("motion in both directions")
    return tuple(lacking)


_ABRUPT = 1e-4  # share of the Stribeck velocity within which the direction changes, as in the law with sgn ω
_Rule = Callable[[np.ndarray, np.ndarray], tuple[list[float], list[float]]]


# Conversion of the parameters of a simpler model to those with the same law, by model and simpler model.
_RULES: Mapping[tuple[str, str], _Rule] = {
    ("asymmetric", "coulomb_viscous_tanh"): lambda b, e: ([b[0], b[1], b[1], 0.0], [1.0 / e[0]]),
    ("asymmetric_stribeck", "asymmetric"): lambda b, e: ([0.0, *b], [e[0], 10.0 * e[0], 2.0, 1.0]),
    ("asymmetric_stribeck", "stribeck"): lambda b, e: ([*b, b[2], 0.0], [_ABRUPT * e[0], *e, 1.0]),
    ("load_dependent", "coulomb_viscous_tanh"): lambda b, e: ([b[0], b[1], 0.0], [1.0 / e[0]]),
    ("temperature_dependent", "coulomb_viscous_tanh"): lambda b, e: ([*b, 0.0, 0.0], [1.0 / e[0]]),
    ("load_temperature_dependent", "load_dependent"): lambda b, e: ([*b, 0.0, 0.0], [e[0]]),
    ("load_temperature_dependent", "temperature_dependent"): lambda b, e: ([*b[:2], 0.0, *b[2:]], [e[0]]),
    ("lugre", "dahl"): lambda b, e: ([b[0], 0.0, b[1]], [e[0], 1.0, 1.0]),
    ("lugre_asymmetric", "lugre"): lambda b, e: ([b[0], b[1], b[2], b[2], 0.0], [*e, 2.0, 1.0]),
}


def inherited_starts(name: str, fits: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    """Return the parameter vectors that give a model the law of a simpler one."""
    found = []
    for (model, parent), rule in _RULES.items():
        if model == name and parent in fits:
            beta, eta = rule(*MODELS[parent].split(fits[parent]))
            found.append(np.concatenate([beta, np.log(eta)]))
    return found


Progress = Callable[[int, int], None]
MAX_SAMPLES = 1_000_000  # largest number for fits and errors; noise of so many changes no displayed digit
_TIE = 2e-4  # share by which errors differ because of rounding of the fits alone


@dataclass(frozen=True, kw_only=True)
class IdentificationOptions:
    """Options of an identification."""

    columns: ColumnOptions = field(default_factory=ColumnOptions)  # columns of the quantities in the logs
    bench: BenchSetup | None = None  # test bench; None for series of friction torques
    processing: Processing = Processing.ZERO_PHASE  # smoothing of the logs of a bench
    fit: FitOptions = field(default_factory=FitOptions)  # options of the fits
    models: tuple[str, ...] = ()  # names of the models; empty for all that the columns allow
    cross_validation: bool = True  # whether to leave files and weights out in turn


@dataclass(frozen=True, eq=False)
class IdentifiedModel:
    """Fitted model with its statistics."""

    fit: Fit  # fit on all samples
    goodness: Goodness  # goodness of fit on all samples
    uncertainty: Uncertainty  # uncertainty of the parameters
    validations: tuple[CrossValidation, ...]  # errors on the samples left out
    residuals: np.ndarray  # residuals of the samples that are used, in [N·m]
    warnings: tuple[str, ...]  # doubts about the fit, one line each

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.fit.model.name

    @property
    def rank(self) -> tuple[float, float]:
        """Criteria of the order of models: the error on files left out, else the Bayesian criterion."""
        left_out = self.validations[0].rmse if self.validations else math.nan
        return (left_out if math.isfinite(left_out) else math.inf, self.goodness.bic)


@dataclass(frozen=True, eq=False)
class Identification:
    """Result of an identification."""

    tests: tuple[FrictionTest, ...]  # the tests after processing
    samples: Samples  # joined samples of the tests; taken evenly if there are more than a million
    models: tuple[IdentifiedModel, ...]  # models, the best first
    skipped: dict[str, tuple[str, ...]]  # models that lack a column, with the column
    options: IdentificationOptions  # options of the identification
    warnings: tuple[str, ...]  # limits of the samples, one line each


def identify_logs(
    paths: Sequence[Path], options: IdentificationOptions, progress: Progress = lambda done, total: None
) -> Identification:
    """Read, process and identify logs, one file a test.

    ``progress`` is called with the number of steps done and their total. Raises ParameterFileError if a file
    cannot be used. Raises ParameterError if an option is wrong or too few samples are left to fit.
    """
    find_models(options.models)
    tests: list[FrictionTest] = []
    for number, path in enumerate(paths):
        tests.append(process_log(read_log(path, options.columns), options.bench, options.processing))
        progress(number, len(paths))
    return identify_tests(tests, options, progress)


def identify_tests(
    tests: Sequence[FrictionTest],
    options: IdentificationOptions,
    progress: Progress = lambda done, total: None,
) -> Identification:
    """Fit models to processed tests; raise the errors of :func:`identify_logs`."""
    tests, flipped = _align_torque_signs(tests)
    if options.fit.loss is Loss.AUTO and any(test.from_bench for test in tests):
        # The filter spreads an outlier, such as a contact with the stop, over samples.
        options = replace(options, fit=replace(options.fit, loss=Loss.HUBER))
    samples = thinned(join_tests(tests), MAX_SAMPLES)
    requested = find_models(options.models)
    lacking = {model.name: missing for model in requested if (missing := _lacking(model, samples))}
    models = [model for model in requested if model.name not in lacking]
    if not models:
        missing_columns = ", ".join(dict.fromkeys(itertools.chain(*lacking.values())))
        raise ParameterError(f"model: the logs have no {missing_columns}, or it does not vary")
    _check_number(samples, models, tests)
    folds = statistics.folds_of(tests, samples) if options.cross_validation else {}
    total, done, found = len(models) * (1 + len(folds)), itertools.count(1), list[IdentifiedModel]()
    for model in models:
        starts = inherited_starts(model.name, {item.name: item.fit.x for item in found})
        fit = fit_model(model, samples, options.fit, seeds=starts)
        progress(next(done), total)
        validations = []
        for by, labels in folds.items():
            validations.append(statistics.cross_validate(fit, samples, by, labels))
            progress(next(done), total)
        values, known = fit.residuals(samples), statistics.uncertainty(fit, samples, options.fit.seed)
        found.append(
            IdentifiedModel(
                fit=fit,
                goodness=statistics.goodness(samples.torque[samples.used], values, model.size),
                uncertainty=known,
                validations=tuple(validations),
                residuals=values,
                warnings=tuple(statistics.fit_warnings(fit, known, samples)),
            )
        )
    return Identification(
        tests=tuple(tests),
        samples=samples,
        models=_best_first(found, _TIE + len(tests) / int(samples.used.sum())),
        skipped=lacking,
        options=options,
        warnings=(
            *flipped,
            *balance_warnings(tests, options.bench, options.processing),
            *delay_warnings(tests, options.bench, options.processing),
            *_file_warnings(tests, options.bench),
            *_sample_warnings(samples),
        ),
    )


def _best_first(models: Sequence[IdentifiedModel], tie: float) -> tuple[IdentifiedModel, ...]:
    """Order models by the error on files left out; the simplest of those that equal the best comes first.

    Errors that differ by less than the share ``tie`` are equal: a dynamic model uses the first torque of
    every test, which improves it by up to one sample in each.
    """
    ordered = sorted(models, key=lambda item: item.rank)
    least = ordered[0].rank[0]
    if not math.isfinite(least):
        return tuple(ordered)
    tied = [item for item in ordered if item.rank[0] <= (1.0 + tie) * least]
    leader = min(tied, key=lambda item: item.fit.model.size)
    return (leader, *(item for item in ordered if item is not leader))


def _align_torque_signs(tests: Sequence[FrictionTest]) -> tuple[list[FrictionTest], list[str]]:
    """Reverse friction torques that oppose the velocity, as in many logs; reject those of a balance."""
    power = sum(float((test.torque * test.velocity)[test.used].sum()) for test in tests)
    if power >= 0.0:
        return list(tests), []
    if any(test.from_bench for test in tests):
        raise ParameterError(
            "logs: the friction from the torque balance drives the joint: current or angle has the wrong "
            "sign; invert it with --columns measured_current=-NAME or angle=-NAME"
        )
    text = "the friction torque has the opposite sign of the velocity in these files; its sign was inverted"
    return [replace(test, torque=-test.torque) for test in tests], [text]


def _check_number(samples: Samples, models: Sequence[FrictionModel], tests: Sequence[FrictionTest]) -> None:
    """Raise ParameterError if too few samples are left, or too few of them move."""
    velocity = samples.velocity[samples.used]
    needed, moving = 3 * max(model.size for model in models), int((velocity != 0.0).sum())
    if len(velocity) < needed:
        lost = sum((Counter(test.counts) for test in tests), Counter[str]())
        causes = ", ".join(f"{lost[name]} by {name}" for name in ("stop", "standstill", "reversal", "edge"))
        text = f"{len(velocity)} samples are left of {len(samples)} ({causes}); expected at least {needed}"
        raise ParameterError(f"logs: {text}")
    if moving < needed or np.ptp(velocity) < 1e-9:
        text = f"the joint moves in {moving} samples, at {velocity.min():g} to {velocity.max():g} rad/s"
        raise ParameterError(f"logs: {text}; expected at least {needed} at several speeds")


_DIRECTION_WARNING_SHARE = 0.05  # share of the samples in the rarer direction below which a warning is given
_FAST, _SLOW = 1.0, 0.1  # [rad/s]: a gait needs the knee up to 3.6; table 3.1 changes below 0.2
_FEW = 0.02  # share of the samples below which there are too few


def _sample_warnings(samples: Samples) -> list[str]:
    """Return warnings about properties that the samples cannot determine with any model."""
    back, few = samples.rarer_direction, f"fewer than {100.0 * _FEW:g} %"
    speed = np.abs(samples.velocity[samples.used])
    doubts = {
        f"one direction only: {100.0 * back:.1f} % of the samples move in the other direction": back
        < _DIRECTION_WARNING_SHARE,
        f"no slow samples: {few} below {_SLOW:g} rad/s": (speed < _SLOW).mean() < _FEW,
        f"no fast samples: {few} above {_FAST:g} rad/s": (speed > _FAST).mean() < _FEW,
    }
    return [text for text, doubtful in doubts.items() if doubtful]


def _file_warnings(tests: Sequence[FrictionTest], bench: BenchSetup | None) -> list[str]:
    """Return warnings about the files."""
    found = []
    for note in dict.fromkeys(note for test in tests for note in test.notes):
        names = [test.name for test in tests if note in test.notes]
        found.append(f"{names[0] if len(names) == 1 else f'{len(names)} files'}: {note}")
    mass = None if bench is None else bench.mass
    others = [f"{test.name} ({test.mass:g} kg)" for test in tests if test.mass not in (None, mass)]
    if mass is not None and others:
        files = f"{len(others)} files whose names state a mass, such as {others[0]}"
        found.append(f"--mass {mass:g} is not used for {files}")
    return found
