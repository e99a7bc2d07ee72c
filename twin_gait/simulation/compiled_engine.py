"""Engine that runs the steps of a tick compiled, with a kernel that is generated for the model."""

from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from twin_gait.control.controller import TickFunction
from twin_gait.kernels.generated import MERGED_FUNCTIONS, KernelBodies, kernel_key, write_kernel
from twin_gait.leg_model.bodies import BodyArrays, contact_points, export_bodies
from twin_gait.simulation.backend import episode_at
from twin_gait.simulation.binding import is_package_function, kernel_functions
from twin_gait.simulation.build_flags import BuildFlags, compute_build_flags
from twin_gait.simulation.code_cache import CompiledLoop, Loop, OnCompile, cached_loop, source_key
from twin_gait.simulation.engine import SWITCHES, EpisodeEngine
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.initial_state import new_episode
from twin_gait.simulation.record import deep_copy, to_array
from twin_gait.simulation.schedule import act, run_ticks, sense
from twin_gait.simulation.simulation_setup import SimulationSetup

_FLOAT = np.dtype(float)


def run_ticks_at(address: int, first: int, end: int) -> int:
    """Run :func:`~twin_gait.simulation.schedule.run_ticks` of the episode at an address."""
    return run_ticks(episode_at(address), first, end)


def run_plant_part(address: int, part: int, tick: int) -> int:
    """Run the steps before the controller (``part`` 0) or after it, and return the status."""
    e = episode_at(address)
    if part == 0:
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
        build_flags: Build flags that the loop is bound to.
        loop: Compiled loop; episodes of one pattern share it.
    """

    chunk_ticks = 2000

    def __init__(self, setup: SimulationSetup, *, on_compile: OnCompile = None) -> None:
        """Build the record of a simulation setup and load or compile its loop.

        ``on_compile``: called if the loop has to be compiled first. Raises UncompiledControllerError if numba
        cannot compile the controller.
        """
        super().__init__(setup)
        self.bodies = _bodies_of(setup)
        self.build_flags = compute_build_flags(setup, len(self.bodies.points))
        self.store = to_array(new_episode(setup, self.bodies))
        self.episode, self.state = self.store[0], self.store.view(np.recarray)[0]
        # Arrays to which the record has addresses; they must exist as long as the engine.
        self.noise = np.ascontiguousarray(setup.noise)
        self.switches = np.zeros(self.episode["recording"]["most_switches"], SWITCHES)
        self.point_at_rows()
        self.loop = load_or_compile_loop(self, on_compile)

    @cached_property
    def specialization_key(self) -> str:
        """Text of all that the loop depends on, except its sources and the functions of the user."""
        functions, bodies = self.setup.controller.tick_functions().values(), kernel_key(self.bodies)
        ours = [(item.__module__, item.__qualname__) for item in functions if is_package_function(item)]
        return repr((text_of(self.store.dtype), self.layout.writer, bodies, self.build_flags, ours))

    @property
    def user_functions(self) -> tuple[TickFunction, ...]:
        """Functions of the controller that the user has written."""
        functions = self.setup.controller.tick_functions().values()
        return tuple(item for item in functions if not is_package_function(item))

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


def assemble(setup: SimulationSetup) -> tuple[KernelBodies, Episode, BuildFlags]:
    """Return the bodies of a simulation setup, its episode at tick 0 as a tree, and its build flags."""
    bodies = _bodies_of(setup)
    return bodies, deep_copy(new_episode(setup, bodies)), compute_build_flags(setup, len(bodies.points))


def _bodies_of(setup: SimulationSetup) -> KernelBodies:
    """Return the bodies of models that share only the ground, in order; the last model has the feet."""
    world, bodies = setup.world, list[BodyArrays]()
    for chain in world.chains:
        first = len(bodies)
        for body in export_bodies(chain.model):
            moved = first > 0 and body.parent >= 0
            bodies.append(body._replace(parent=body.parent + first) if moved else body)
    frames = [world.contact_frames.get(side, ()) for side in setup.wearer_sides]
    found = [point for names in frames for point in contact_points(world.chains[-1].model, names)]
    points = [point._replace(body=point.body + first) for point in found]
    control = export_bodies(setup.control_model.model)
    # Index of the last guide of each pelvis, or on the bench of the first joint of each chain.
    guides = range(world.model.pelvis_index or 0, len(bodies), world.model.nv)
    return KernelBodies(bodies, points, control, world.model.up_axis, guides, world.slope != 0.0)


def load_or_compile_loop(
    engine: CompiledEngine, on_compile: OnCompile, entry: Callable[[int, int, int], int] = run_ticks_at
) -> Loop:
    """Return the loop for episodes with the pattern of an engine, compiled if it is not in the code cache.

    ``entry``: function that is compiled; :func:`run_plant_part` gives the plant alone. Raises
    UncompiledControllerError if numba cannot compile the controller.
    """

    def make() -> CompiledLoop:
        from twin_gait.simulation.compiling import compile_loop, compile_user_tick, record_accessor
        from twin_gait.simulation.vectors import vector_functions

        bound, user_ticks = loop_names(engine), {}
        controller, episode = engine.setup.controller, engine.store.dtype
        for name, tick in controller.tick_functions().items():
            if not is_package_function(tick):
                assisted, device = name == "assisted_tick", episode["controller"]
                user_ticks[name] = compile_user_tick(controller.name, tick, assisted, device)
        names = {**bound, **user_ticks, **vector_functions(bound), "episode_at": record_accessor(episode)}
        return compile_loop(entry, names, user_controller=controller.name if user_ticks else "")

    return cached_loop(
        source_key(f"{entry.__name__} {engine.specialization_key}"), make, on_compile, engine.user_functions
    )


def loop_names(engine: CompiledEngine) -> dict[str, Any]:
    """Return all functions and constants that a loop is bound to, except the access to its episodes."""
    return {
        **engine.build_flags,
        **engine.setup.controller.tick_functions(),
        **kernel_names(engine.bodies),
        **kernel_functions(engine.layout.writer, {}),
        **compiled_rows(len(engine.layout.names), engine.noise.shape[1]),
    }


@lru_cache(maxsize=32)
def text_of(dtype: np.dtype[Any]) -> str:
    """Return a dtype as text; cached, because it would be the slowest part of the start of an episode."""
    return repr(dtype)


def kernel_names(bodies: KernelBodies, laws: Mapping[str, Callable[..., Any]] = {}) -> dict[str, Any]:
    """Return the functions of the generated kernel of some bodies by name, ready to be bound.

    ``laws``: functions that replace functions of ``core`` that the kernel calls, by their names.
    """
    called = {item.name: laws.get(item.name, item.function) for item in MERGED_FUNCTIONS}
    return kernel_functions(write_kernel(bodies), called)


@lru_cache(maxsize=32)
def compiled_rows(width: int, noises: int) -> dict[str, Any]:
    """Return the functions of :mod:`twin_gait.simulation.backend` that read rows at addresses.

    ``width`` and ``noises``: numbers in a row of the log and in a row of the noise.
    """
    from twin_gait.simulation.compiling import jit, row_accessor

    logs, readings, switches = (
        row_accessor(_FLOAT, width),
        row_accessor(_FLOAT, noises),
        row_accessor(SWITCHES),
    )

    def log_row(e: Episode, tick: int) -> Any:
        return logs(e.recording.log, tick - e.recording.first_row)

    def switch_row(e: Episode, number: int) -> Any:
        return switches(e.recording.switches, number)

    def noise_row(e: Episode, tick: int) -> Any:
        return readings(e.recording.noise, tick % e.recording.n_noise)

    return {item.__name__: jit(item) for item in (log_row, switch_row, noise_row)}
