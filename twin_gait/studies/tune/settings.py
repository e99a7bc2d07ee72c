"""How a table is tuned, and what makes one tuning another than the next."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Any

from twin_gait.configuration.documents import content_hash, experiment_document
from twin_gait.exceptions import MissingOptionalDependency, ParameterError
from twin_gait.experiment import Experiment
from twin_gait.measures.reference import KILOMETRES_PER_HOUR, reference_covers
from twin_gait.studies.jobs import sources_hash
from twin_gait.studies.tune.parts import AIM, FALL, NEEDED_CLEARANCE, PARTS, WORST
from twin_gait.studies.tune.screening import FEWEST, KEPT_SHARE, LEVELS, REACH, TRAJECTORIES
from twin_gait.studies.tune.search import FIRST_STEP, POPULATION
from twin_gait.studies.tune.tuning import NOMINAL_WEIGHT


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a table is tuned.

    Attributes:
        reference_speed: Speed of the reference walk in [m] / [s]; None for the belt's.
        minutes: Time for everything; generations under way are finished.
        generations: Of the search; None until the time is over. With a number the result does not depend on
            the machine's speed.
        seed: Of screening, search and sensor noise.
        screening: Whether the search is narrowed to the numbers that matter.
        thresholds: Whether angle thresholds count.
        blending: Whether the duration of the blend counts.
        per_side: Whether each leg gets numbers of its own (hemiparesis).
        population: Candidates of a generation.
        trajectories: Of the screening.
        search_duration: Length of a walk in screening and search in [s].
        robust_duration: Length of a walk of the robust set in [s].
    """

    reference_speed: float | None = None
    minutes: float = 10.0
    generations: int | None = None
    seed: int = 0
    screening: bool = True
    thresholds: bool = True
    blending: bool = True
    per_side: bool = False
    population: int = POPULATION
    trajectories: int = TRAJECTORIES
    search_duration: float = 14.0
    robust_duration: float = 20.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0.0 < self.minutes < float("inf"):
            raise ParameterError(f"minutes: expected a number above 0, got {self.minutes}")
        if self.generations is not None and self.generations < 1:
            raise ParameterError(f"generations: expected 1 or more, got {self.generations}")
        if self.seed < 0:
            raise ParameterError(f"seed: expected a whole number of 0 or more, got {self.seed}")
        if self.population < 4:
            raise ParameterError(f"population: expected 4 or more, got {self.population}")
        speed = self.reference_speed
        if speed is not None and not reference_covers(speed):
            raise ParameterError(
                f"reference: Koopman's curves cover 0.5 to 5 km/h, got {speed * KILOMETRES_PER_HOUR:g}"
            )


def identity(experiment: Experiment, settings: Settings) -> dict[str, Any]:
    """What makes a tuning this one: a kept state of another cannot be gone on with."""
    chosen = asdict(settings)
    del chosen["minutes"], chosen["generations"]
    return {
        "experiment": content_hash(experiment_document(experiment)),
        **chosen,
        "parts": {part.name: [part.goal, part.weight, part.excess] for part in PARTS},
        "costs": [WORST, FALL, AIM, NEEDED_CLEARANCE, NOMINAL_WEIGHT],
        "steps": [FIRST_STEP, REACH, LEVELS, KEPT_SHARE, FEWEST],
        "sources": sources_hash(),
        "versions": {name: _version(name) for name in ("cma", "SALib", "numpy")},
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError as error:
        raise MissingOptionalDependency(package, "tune", "twin-gait tune") from error
