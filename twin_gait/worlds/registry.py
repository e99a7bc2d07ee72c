"""Registry of the worlds: one module each in this package, and those that other packages provide."""

import traceback
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from inspect import isabstract
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.quantities import require
from twin_gait.worlds.world import Scenario, World

GROUP = "twin_gait.worlds"  # group of entry points, each named by the kind of its world


@cache
def _shipped() -> dict[str, type[Scenario]]:
    names = [item.name for item in iter_modules([str(Path(__file__).parent)]) if not item.ispkg]
    modules = [import_module(f"{__package__}.{name}") for name in sorted(names)]
    return {item.kind: item for module in modules for item in vars(module).values() if _is_world(item)}


def _is_world(item: Any) -> bool:
    return isinstance(item, type) and issubclass(item, Scenario) and not isabstract(item)


def world_kinds() -> tuple[str, ...]:
    """Return the kinds of all available worlds; those of other packages are not loaded for it."""
    return (*_shipped(), *entry_points(group=GROUP).names)


def find_world(kind: str) -> type[Scenario]:
    """Return the class of a world.

    Raises ParameterError if there is no such world, or if the package that provides it is broken.
    """
    if kind in _shipped():
        return _shipped()[kind]
    brought = tuple(entry_points(group=GROUP, name=kind))
    if not brought:
        raise ParameterError(
            f"there is no world {kind!r}; expected one of {', '.join(world_kinds())}; another one needs the "
            "package that has it"
        )
    world = load_plugin(brought[0])
    if not _is_world(world) or getattr(world, "kind", None) != kind:
        raise ParameterError(
            f"{describe_entry_point(brought[0])}: expected a Scenario with the kind {kind}; repair it"
        )
    found: type[Scenario] = world
    return found


def build_world(scenario: Scenario, model: LegModel, **surroundings: Any) -> World:
    """Build a world, see :meth:`Scenario.build`.

    Raises ParameterError if the package of a world that does not ship with the program has a mistake.
    """
    name, shipped = f"world {scenario.kind!r}", type(scenario).__module__.startswith("twin_gait.")
    try:
        world: Any = scenario.build(model, **surroundings)
    except Exception as error:
        if shipped or isinstance(error, TwinGaitError):
            raise
        line = traceback.extract_tb(error.__traceback__)[-1]
        problem = f"{type(error).__name__}: {error}, {line.filename}, line {line.lineno}"
        raise ParameterError(f"{name} cannot be built ({problem}); correct its package") from error
    if not isinstance(world, World):
        raise ParameterError(f"{name}: build: expected a World, got {world!r}")
    shapes = [getattr(start, "shape", None) for start in (world.start_q, world.start_v)]
    sides, leg_sides = [str(side) for side in world.initial_phases], [str(side) for side in model.sides]
    fit = shapes == 2 * [(len(world.plant),)] and len(world.plant) >= model.nv
    lengths = f"start_q, start_v and plant of one length, {model.nv} or more"
    require(fit, f"{name}: build", f"arrays {lengths}", (*shapes, len(world.plant)))
    require({*sides} == {*leg_sides}, f"{name}: initial_phases", ", ".join(leg_sides), ", ".join(sides))
    return world


def load_plugin(entry: EntryPoint) -> Any:
    """Load the object of an entry point of another package.

    Raises ParameterError if it cannot be imported.
    """
    try:
        return entry.load()
    except Exception as error:  # importing another package may raise any exception
        problem = f"{type(error).__name__}: {error}"
        raise ParameterError(
            f"{describe_entry_point(entry)} cannot be loaded ({problem}); repair or uninstall it"
        ) from error


def describe_entry_point(entry: EntryPoint) -> str:
    """Return a description of an entry point that begins a message."""
    package = "" if entry.dist is None else f" of the package {entry.dist.name}"
    return f"plug-in {entry.value}{package}"
