"""The controllers that can be compared, each as a change of one experiment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from twin_gait.exceptions import ParameterError
from twin_gait.experiment import AssistanceParameters, ControlMode, Experiment
from twin_gait.vocabulary import JointName

# TwinCare gives each joint a share of the table's impedance; four fifths is an assumption. An experiment that
# sets shares of its own keeps them.
TWINCARE_SHARE = 0.8


@dataclass(frozen=True)
class Controller:
    """One way to drive the legs.

    Attributes:
        name: On the command line and in tables.
        title: In a report.
        explanation: What it does, in plain words.
        change: Makes an experiment with this controller.
    """

    name: str
    title: str
    explanation: str
    change: Callable[[Experiment], Experiment]


def _driven(mode: ControlMode) -> Callable[[Experiment], Experiment]:
    def change(experiment: Experiment) -> Experiment:
        control = replace(experiment.control, mode=mode, assistance=AssistanceParameters())
        return replace(experiment, control=control)

    return change


def _adapting(experiment: Experiment) -> Experiment:
    assistance = replace(experiment.control.assistance, adaptive=True)
    control = replace(experiment.control, mode=ControlMode.IMPEDANCE, assistance=assistance)
    return replace(experiment, control=control)


def _twincare(experiment: Experiment) -> Experiment:
    assistance = replace(experiment.control.assistance, adaptive=False)
    if assistance.is_full:
        shares = {JointName.HIP: TWINCARE_SHARE, JointName.KNEE: TWINCARE_SHARE}
        assistance = replace(assistance, share=shares)
    control = replace(experiment.control, mode=ControlMode.IMPEDANCE, assistance=assistance)
    return replace(experiment, control=control)


_ALL = (
    Controller(
        "table", "five-phase table", "spring and damper of the gait table", _driven(ControlMode.IMPEDANCE)
    ),
    Controller(
        "position",
        "position tracking",
        "a stiff spring that follows a predetermined path",
        _driven(ControlMode.POSITION),
    ),
    Controller(
        "assist_as_needed",
        "assist as needed",
        "the table; from stride to stride as much of it as the walk needs",
        _adapting,
    ),
    Controller("twincare", "partial help", "the table, a fixed share of it per joint", _twincare),
    Controller(
        "transparent",
        "friction compensation only",
        "no spring; the gear's friction and the leg's weight in swing are carried",
        _driven(ControlMode.TRANSPARENT),
    ),
    Controller(
        "gravity",
        "gravity compensation",
        "no spring; friction and the leg's whole weight are carried",
        _driven(ControlMode.GRAVITY),
    ),
    Controller(
        "constant",
        "constant impedance",
        "one spring for the whole stride, the mean of the table's",
        _driven(ControlMode.CONSTANT),
    ),
)
CONTROLLERS = {item.name: item for item in _ALL}


def find_controllers(names: Sequence[str]) -> tuple[Controller, ...]:
    """Look controllers up.

    Args:
        names: For example ``table`` and ``position``.

    Returns:
        The controllers in the same order.

    Raises:
        ParameterError: If there is none of a name, or one is named twice.
    """
    if not names:
        raise ParameterError(f"controllers: expected some of {', '.join(CONTROLLERS)}")
    for place, name in enumerate(names):
        if name not in CONTROLLERS:
            raise ParameterError(f"controllers: no {name!r}; there are {', '.join(CONTROLLERS)}")
        if name in names[:place]:
            raise ParameterError(f"controllers: {name} is named twice; leave one out")
    return tuple(CONTROLLERS[name] for name in names)
