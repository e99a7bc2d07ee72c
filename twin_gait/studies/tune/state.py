"""Settings, progress and result of a tuning."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from twin_gait.exceptions import ParameterError
from twin_gait.studies.tune.parts import Rating
from twin_gait.studies.tune.search import Generation
from twin_gait.studies.tune.space import Parameter
from twin_gait.studies.tune.walks import weighted_cost


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a table is tuned."""

    minutes: float = 3.0  # time for everything; generations under way are finished
    # of the search; None until the time is over. With a number the result does not depend on the machine's
    # speed
    generations: int | None = None
    seed: int = 0  # of the sensor noise; the search has no chance in it
    thresholds: bool = True  # whether angle thresholds count
    blending: bool = True  # whether the duration of the blend counts
    per_side: bool = False  # whether each leg gets numbers of its own (hemiparesis)
    # whether the table is for other wearers, supports and belts too, as one that ships is: search and robust
    # set then have corner_cases in them
    everyone: bool = False
    search_duration: float = 14.0  # length of a walk in the search in [s]
    robust_duration: float = 20.0  # length of a walk of the robust set in [s]

    def __post_init__(self) -> None:
        if not 0.0 < self.minutes < float("inf"):
            raise ParameterError(f"minutes: expected a number above 0, got {self.minutes}")
        if self.generations is not None and self.generations < 1:
            raise ParameterError(f"generations: expected 1 or more, got {self.generations}")
        if self.seed < 0:
            raise ParameterError(f"seed: expected a whole number of 0 or more, got {self.seed}")


class Progress(NamedTuple):
    """Where a tuning stands."""

    stage: str  # ``compiling``, ``search`` or ``robust set``
    done: int  # of this stage: walks, or generations
    total: int | None  # in all, or None while only the time ends it
    elapsed: float  # in [s]
    costs: tuple[float, float] | None  # of the table that it began with and of the best so far, once known


@dataclass(frozen=True, eq=False)
class Finalist:
    """A table that walked the robust set."""

    table: dict[str, Any]  # its document
    # coordinates of what was searched for; None for the table that it began with
    points: tuple[float, ...] | None
    search_cost: float  # in the search
    walks: tuple[tuple[str, Rating], ...]  # name of the case and result, nominal first

    @property
    def falls(self) -> int:
        """Cases in which it fell."""
        return sum(walk.fell for _, walk in self.walks)

    @property
    def cost(self) -> float:
        """Cost over the robust set; the nominal case weighs as much as in the search."""
        return weighted_cost([walk for _, walk in self.walks])


@dataclass(frozen=True, eq=False)
class Tuning:
    """Result of a tuning."""

    parameters: tuple[Parameter, ...]  # all numbers that were searched for
    generations: tuple[Generation, ...]  # of the search; the first is its start
    before: Finalist  # the table that was to be bettered
    ranked: tuple[Finalist, ...]  # all finalists, the best first; ``before`` is one of them
    elapsed: float  # time that it took in [s]
