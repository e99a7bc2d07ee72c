"""Types of a schedule: the steps of a tick in their order, and the parts of an episode they run over.

A step is a function of one episode, or of one joint, leg, sole or limb of it; the names of its arguments
select the records that are passed to it. A schedule is a tuple of steps and of the groups below, which may be
nested. It does not define how many episodes run at once: that is up to :mod:`twin_gait.simulation.executors`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

Step: TypeAlias = Callable[..., Any]
Schedule: TypeAlias = tuple[Any, ...]  # Steps, groups, and other schedules.


@dataclass(frozen=True)
class ForEach:
    """Steps of every joint, leg, sole or limb, one after the other."""

    parts: str  # Name of the parts, such as ``joints``.
    steps: Schedule


@dataclass(frozen=True)
class When:
    """Steps under a condition on build flags, the tick and shared fields, the same for all episodes."""

    condition: str
    steps: Schedule
    otherwise: Schedule


@dataclass(frozen=True)
class VectorBranch:
    """Steps that run for all episodes if a test is true for any of them; no effect in the other episodes."""

    test: Step
    steps: Schedule


@dataclass(frozen=True)
class ScalarBranch:
    """Steps for the episodes for which a test is true, one episode after the other."""

    test: Step
    steps: Schedule


@dataclass(frozen=True)
class ScalarSteps:
    """Steps that cannot become vector code and run one episode after the other."""

    steps: Schedule


@dataclass(frozen=True)
class BlockStep:
    """A function of all episodes at once, with its own loops over them."""

    function: Step


def joints(*steps: Any) -> ForEach:
    """Group steps that run over the joints."""
    return ForEach("joints", steps)


def legs(*steps: Any) -> ForEach:
    """Group steps that run over the legs."""
    return ForEach("legs", steps)


def feet(*steps: Any) -> ForEach:
    """Group steps that run over the feet."""
    return ForEach("feet", steps)


def limbs(*steps: Any) -> ForEach:
    """Group steps that run over hips and knees of the wearer."""
    return ForEach("limbs", steps)


def wearer_legs(*steps: Any) -> ForEach:
    """Group steps that run over the legs of the wearer, with or without a device."""
    return ForEach("wearer_legs", steps)


def own_joints(*steps: Any) -> ForEach:
    """Group steps that run over the joints of the wearer's own gait."""
    return ForEach("own_joints", steps)


def when(condition: str, *steps: Any, otherwise: Schedule = ()) -> When:
    """Group steps that run under a condition, and those that run otherwise."""
    return When(condition, steps, otherwise)


def vector_branch(test: Step, *steps: Any) -> VectorBranch:
    """Group steps that run for all episodes if a test is true for any of them."""
    return VectorBranch(test, steps)


def scalar_branch(test: Step, *steps: Any) -> ScalarBranch:
    """Group steps that run for the few episodes for which a test is true."""
    return ScalarBranch(test, steps)


def scalar_steps(*steps: Any) -> ScalarSteps:
    """Group steps that cannot become vector code."""
    return ScalarSteps(steps)


def replace_steps(schedule: Schedule, replacements: Mapping[Any, Any]) -> Schedule:
    """Return a schedule with other steps in place of some of its steps or groups.

    Raises KeyError for something that the schedule does not contain.
    """
    found = set[Any]()

    def replace(item: Any) -> Any:
        if item in replacements:
            found.add(item)
            return replacements[item]
        match item:
            case tuple():
                return tuple(map(replace, item))
            case ForEach(parts, steps):
                return ForEach(parts, replace(steps))
            case When(condition, steps, otherwise):
                return When(condition, replace(steps), replace(otherwise))
            case VectorBranch(test, steps):
                return VectorBranch(test, replace(steps))
            case ScalarBranch(test, steps):
                return ScalarBranch(test, replace(steps))
            case ScalarSteps(steps):
                return ScalarSteps(replace(steps))
        return item

    made: Schedule = replace(schedule)
    if found != replacements.keys():
        raise KeyError(f"not in the schedule: {sorted(map(str, replacements.keys() - found))}")
    return made
