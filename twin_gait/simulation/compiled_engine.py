"""Engine that runs the steps of a tick compiled, with a kernel that is generated for the model."""

from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from twin_gait.control.controller import TickFunction
from twin_gait.kernels.generated import SIDE_BY_SIDE, KernelBodies, kernel_structure, write_kernel
from twin_gait.leg_model.bodies import BodyArrays, contact_points, export_bodies
from twin_gait.simulation.binding import is_ours, kernel_functions
from twin_gait.simulation.engine import SWITCHES, EpisodeEngine
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.filling import new_episode
from twin_gait.simulation.interface import episode_at
from twin_gait.simulation.keeping import CompiledLoop, Loop, OnCompile, kept_loop, source_key
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.record import copied, stored
from twin_gait.simulation.schedule import act, run_ticks, sense
from twin_gait.simulation.structure import Structure, structure_of

_FLOAT = np.dtype(float)


def run_at(address: int, first: int, end: int) -> int:
    """Run :func:`~twin_gait.simulation.schedule.run_ticks` of the episode at an address."""
    return run_ticks(episode_at(address), first, end)


def run_part(address: int, acting: int, tick: int) -> int:
    """Run the steps before the controller (``acting`` 0) or after it, and return the status."""
    e = episode_at(address)
    if acting == 0:
        sense(e, tick)
    else:
        act(e, tick)
    return e.status


class CompiledEngine(EpisodeEngine):
    """Engine that runs one simulation setup from start to end in compiled code.

    Attributes:
        store: Array of shape ``(1,)`` with the record; the loop changes only it, log and switches.
        episode: Record of the episode.
        noise: Sensor noise and effort noise of each tick.
        bodies: Bodies and points for which the kernel is generated.
        structure: Build flags that the loop is bound to.
        loop: Compiled loop; episodes of one pattern share it.
    """

    chunk_ticks = 2000

    def __init__(self, problem: Problem, *, on_compile: OnCompile = None) -> None:
        """Build the record of a simulation setup and load or compile its loop.

        ``on_compile``: called if the loop has to be compiled first. Raises UncompiledControllerError if numba
        cannot compile the controller.
        """
        super().__init__(problem)
        self.bodies = _bodies_of(problem)
        self.structure = structure_of(problem, len(self.bodies.points))
        self.store = stored(new_episode(problem, self.bodies))
        self.episode, self.state = self.store[0], self.store.view(np.recarray)[0]
        # Arrays to which the record has addresses; they must exist as long as the engine.
        self.noise = np.ascontiguousarray(problem.noise)
        self.switches = np.zeros(self.episode["recording"]["most_switches"], SWITCHES)
        self.point_at_rows()
        self.loop = loop_of(self, on_compile)

    @cached_property
    def pattern(self) -> str:
        """Text of all that the loop depends on, except its sources and the functions of the user."""
        functions, bodies = self.problem.controller.functions().values(), kernel_structure(self.bodies)
        ours = [(item.__module__, item.__qualname__) for item in functions if is_ours(item)]
        return repr((text_of(self.store.dtype), self.layout.writer, bodies, self.structure, ours))

    @property
    def own(self) -> tuple[TickFunction, ...]:
        """Functions of the controller that the user has written."""
        functions = self.problem.controller.functions().values()
        return tuple(item for item in functions if not is_ours(item))

    def point_at_rows(self) -> None:
        """Write the addresses of switches and noise into the record; :meth:`run_ticks` writes the log's."""
        recording = self.episode["recording"]
        recording["switches"], recording["noise"] = self.switches.ctypes.data, self.noise.ctypes.data

    def run_ticks(self, first: int, end: int, rows: np.ndarray, first_row: int = 0) -> int:
        """Run ticks; see :meth:`EpisodeEngine.run_ticks`."""
        assert rows.flags.c_contiguous and rows.dtype == float  # the loop writes at its address
        recording = self.episode["recording"]
        recording["log"], recording["first_row"] = rows.ctypes.data, first_row
        return self.loop(self.store.ctypes.data, first, end)


def laid_out(problem: Problem) -> tuple[KernelBodies, Episode, Structure]:
    """Return the bodies of a simulation setup, its episode at tick 0 as a tree, and its build flags."""
    bodies = _bodies_of(problem)
    return bodies, copied(new_episode(problem, bodies)), structure_of(problem, len(bodies.points))


def _bodies_of(problem: Problem) -> KernelBodies:
    """Return the bodies of models that share only the ground, in order; the last model has the feet."""
    world, bodies = problem.world, list[BodyArrays]()
    for chain in world.chains:
        first = len(bodies)
        for body in export_bodies(chain.model):
            moved = first > 0 and body.parent >= 0
            bodies.append(body._replace(parent=body.parent + first) if moved else body)
    frames = [name for side in problem.sides for name in world.contact_frames.get(side, ())]
    found = contact_points(world.chains[-1].model, frames)
    points = [point._replace(body=point.body + first) for point in found]
    control = export_bodies(problem.control_model.model)
    # Index of the last guide of each pelvis, or on the bench of the first joint of each chain.
    guides = range(world.model.pelvis_index or 0, len(bodies), world.model.nv)
    return KernelBodies(bodies, points, control, world.model.up_axis, guides, world.slope != 0.0)


def loop_of(
    engine: CompiledEngine, on_compile: OnCompile, entry: Callable[[int, int, int], int] = run_at
) -> Loop:
    """Return the loop for episodes with the pattern of an engine, compiled if it is not in the code cache.

    ``entry``: function that is compiled; :func:`run_part` gives the plant alone. Raises
    UncompiledControllerError if numba cannot compile the controller.
    """

    def make() -> CompiledLoop:
        from twin_gait.simulation.compiling import compile_loop, compiled_tick, record_at
        from twin_gait.simulation.vectors import in_vectors

        bound, own = bound_to(engine), {}
        controller, episode = engine.problem.controller, engine.store.dtype
        for name, tick in controller.functions().items():
            if not is_ours(tick):
                assisted, device = name == "assisted_tick", episode["controller"]
                own[name] = compiled_tick(controller.name, tick, assisted, device)
        names = {**bound, **own, **in_vectors(bound), "episode_at": record_at(episode)}
        return compile_loop(entry, names, own=controller.name if own else "")

    return kept_loop(source_key(f"{entry.__name__} {engine.pattern}"), make, on_compile, engine.own)


def bound_to(engine: CompiledEngine) -> dict[str, Any]:
    """Return all functions and constants that a loop is bound to, except the access to its episodes."""
    return {
        **engine.structure,
        **engine.problem.controller.functions(),
        **bound_kernel(engine.bodies),
        **kernel_functions(engine.layout.writer, {}),
        **compiled_rows(len(engine.layout.names), engine.noise.shape[1]),
    }


@lru_cache(maxsize=32)
def text_of(dtype: np.dtype[Any]) -> str:
    """Return a dtype as text; cached, because it would be the slowest part of the start of an episode."""
    return repr(dtype)


def bound_kernel(bodies: KernelBodies, laws: Mapping[str, Callable[..., Any]] = {}) -> dict[str, Any]:
    """Return the functions of the generated kernel of some bodies by name, ready to be bound.

    ``laws``: functions that replace functions of ``core`` that the kernel calls, by their names.
    """
    called = {item.name: laws.get(item.name, item.function) for item in SIDE_BY_SIDE}
    return kernel_functions(write_kernel(bodies), called)


@lru_cache(maxsize=32)
def compiled_rows(width: int, noises: int) -> dict[str, Any]:
    """Return the functions of :mod:`twin_gait.simulation.interface` that read rows at addresses.

    ``width`` and ``noises``: numbers in a row of the log and in a row of the noise.
    """
    from twin_gait.simulation.compiling import jit, rows_at

    logs, readings, switches = rows_at(_FLOAT, width), rows_at(_FLOAT, noises), rows_at(SWITCHES)

    def log_row(e: Episode, tick: int) -> Any:
        return logs(e.recording.log, tick - e.recording.first_row)

    def switch_row(e: Episode, number: int) -> Any:
        return switches(e.recording.switches, number)

    def noise_row(e: Episode, tick: int) -> Any:
        return readings(e.recording.noise, tick % e.recording.n_noise)

    return {item.__name__: jit(item) for item in (log_row, switch_row, noise_row)}
