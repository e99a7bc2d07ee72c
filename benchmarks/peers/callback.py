"""The rooms of a tick as a callback of MuJoCo, which integrates: plain Python, or one native function.

MuJoCo asks at every stage of its integrator. At the first one of a tick the rooms run, but for the
integration; at each of them the plant gives its passive torques, and the dynamics are left to MuJoCo.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numba
import numpy as np

from twin_gait.experiment.problem import Problem
from twin_gait.simulation.binding import bind
from twin_gait.simulation.compiled_engine import (
    CompiledEngine,
    bound_kernel,
    compiled_rows,
    laid_out,
)
from twin_gait.simulation.compiling import ON_BITS, jit, numbers_at, quickly, record_at
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.record import dtype_of
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.rooms.motion import acceleration
from twin_gait.simulation.rooms.tick import run_ticks

# What the callback is bound to: place of every coordinate in MuJoCo's arrays, and how often MuJoCo asks in a
# tick, stages times substeps.
PLACES: tuple[int, ...] = ()
EVALUATIONS = 1
# Contacts are MuJoCo's own, no gait table of the benchmark asks for the load of a foot, and no friction
# remembers anything from step to step.
STRUCTURE = {"RK4": False, "POINTS_PER_FOOT": 0, "OTHER_LAWS": False}

_CALLS = np.dtype([("made", "i8")])


def trace_row(tick: int) -> Any:
    """Room for the coordinates of a tick."""
    raise NotImplementedError


def respond(e: Episode, call: int, q: Any, v: Any, applied: Any) -> None:
    """Torques on the coordinates of MuJoCo at one of its evaluations.

    Args:
        e: The episode; changed in place.
        call: Number of the evaluation since the start.
        q: Coordinates of MuJoCo.
        v: Velocities.
        applied: Torques; changed in place.
    """
    for i in range(len(PLACES)):
        e.q[i] = q[PLACES[i]]
        e.v[i] = v[PLACES[i]]
    if call % EVALUATIONS == 0:
        tick = call // EVALUATIONS
        row = trace_row(tick)
        for i in range(len(PLACES)):
            row[i] = e.q[i]
        run_ticks(e, tick, tick + 1)
    acceleration(e, 0.0, e.q, e.v)
    for i in range(len(PLACES)):
        applied[PLACES[i]] = e.torque[i]


def _integrate(e: Episode, tick: int) -> None:
    """Left to MuJoCo."""


def _dynamics(
    q: Any, v: Any, torque: Any, bodies: Any, gravity: float, ground: Any, a: Any, points: Any
) -> float:
    """Left to MuJoCo; contacts without power."""
    return 0.0


def _names(problem: Problem, order: Sequence[int], evaluations: int) -> dict[str, Any]:
    """What both callbacks are bound to: structure, kernel, and MuJoCo's arrays."""
    kernel, _, structure = laid_out(problem, record=False)
    assert not structure["OTHER_LAWS"]
    places = {"PLACES": tuple(order), "EVALUATIONS": evaluations}
    return {**structure, **bound_kernel(kernel), **STRUCTURE, **places}


class PythonCallback:
    """The rooms as they stand.

    Attributes:
        trace: Coordinates at every tick, shape ``(n_ticks, nv)``.
    """

    def __init__(self, problem: Problem, order: Sequence[int], evaluations: int, ticks: int) -> None:
        """Bind the rooms.

        Args:
            problem: The problem.
            order: Place of every coordinate in MuJoCo's arrays.
            evaluations: How often MuJoCo asks in one tick: stages times substeps.
            ticks: Length of a run.
        """
        self.trace = np.zeros((ticks, len(order)))
        own = {"integrate": _integrate, "dynamics": _dynamics, "trace_row": self.trace.__getitem__}
        self._problem, self._names = problem, {**_names(problem, order, evaluations), **own}
        self.reset()

    def reset(self) -> None:
        """Go back to the start."""
        engine = ReferenceEngine(self._problem, kernel=self._names)
        engine.episode.recording.on = False
        rows, self._calls, self._episode = np.zeros((0, 0)), 0, engine.episode
        ticking = {"run_ticks": lambda e, first, end: engine.run_ticks(first, end, rows)}
        self._respond = bind(respond, {**self._names, **ticking})

    def function(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """For ``mujoco.set_mjcb_control``."""
        self._respond(self._episode, self._calls, data.qpos.tolist(), data.qvel.tolist(), data.qfrc_applied)
        self._calls += 1


class NativeCallback:
    """The rooms compiled for one set of MuJoCo's arrays, because a callback of C gets no arguments of ours.

    Attributes:
        trace: Coordinates at every tick, shape ``(n_ticks, nv)``.
        function: For ``mujoco.set_mjcb_control``.
    """

    def __init__(
        self, problem: Problem, order: Sequence[int], evaluations: int, ticks: int, data: mujoco.MjData
    ) -> None:
        """Compile the rooms; ``data`` are MuJoCo's arrays, the rest as in :class:`PythonCallback`."""
        self.trace = np.zeros((ticks, len(order)))
        self._engine, self._calls = CompiledEngine(problem, record=False), np.zeros(1, _CALLS)
        self._start = [part.copy() for part in self._engine.parts]
        with quickly():
            self._native = self._compiled(_names(problem, order, evaluations), data)
        self.function = self._native.ctypes

    def reset(self) -> None:
        """Go back to the start."""
        self._calls["made"] = 0
        for part, start in zip(self._engine.parts, self._start, strict=True):
            part[...] = start

    def _compiled(self, names: Mapping[str, Any], data: mujoco.MjData) -> Any:
        store, _ = self._engine.parts
        table, trace = numbers_at(self.trace.shape[1]), self.trace.ctypes.data
        own = {
            **compiled_rows(store.dtype, dtype_of(self._engine.layout.row())),
            "integrate": jit(_integrate),
            "dynamics": jit(_dynamics),
            "trace_row": jit(lambda tick: table(trace, tick)),
        }
        rooms = bind(respond, {**ON_BITS, **names, **own}, jit)
        episode_at, calls_at, numbers = record_at(store.dtype), record_at(_CALLS), numbers_at(data.qpos.size)
        home, counter = store.ctypes.data, self._calls.ctypes.data
        q, v, applied = (array.ctypes.data for array in (data.qpos, data.qvel, data.qfrc_applied))

        @numba.cfunc("void(voidptr, voidptr)", error_model="numpy")
        def native(model: Any, data: Any) -> None:
            calls = calls_at(counter)
            rooms(episode_at(home), calls.made, numbers(q, 0), numbers(v, 0), numbers(applied, 0))
            calls.made += 1

        return native
