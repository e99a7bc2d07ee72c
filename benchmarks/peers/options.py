"""Options of MuJoCo that might make it faster, each timed in turn with the model of the benchmark."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from peers.mujoco_peers import BareSession, RolloutSession, StateBatchSession, disabling
from peers.scenarios import Case
from peers.timing import speed_ratio, time_in_turn

from twin_gait.simulation.block import WIDTH

Change = Callable[[mujoco.MjModel], None]
SAME_MOTION = 1e-12  # [rad]
LIKE = "as timed"


def _set(**values: Any) -> Change:
    def change(model: mujoco.MjModel) -> None:
        for name, value in values.items():
            setattr(model.opt, name, value)

    return change


def _flags(names: str, *, disabled: bool) -> Change:
    bits = disabling(names.split())

    def change(model: mujoco.MjModel) -> None:
        flags = model.opt.disableflags
        model.opt.disableflags = flags | bits if disabled else flags & ~bits

    return change


def _frictionless(model: mujoco.MjModel) -> None:
    model.geom_condim[:] = 1


INTEGRATOR, SOLVER = mujoco.mjtIntegrator, mujoco.mjtSolver
OPTIONS: dict[str, Change] = {
    "nothing disabled, as MuJoCo comes": _set(disableflags=0),
    "damping implicit (eulerdamp)": _flags("EULERDAMP", disabled=False),
    "islands": _flags("ISLAND", disabled=False),
    "no warm start": _flags("WARMSTART", disabled=True),
    "no refsafe, autoreset, filterparent, nativeccd, multiccd": _flags(
        "REFSAFE AUTORESET FILTERPARENT NATIVECCD MULTICCD", disabled=True
    ),
    "integrator implicitfast": _set(integrator=INTEGRATOR.mjINT_IMPLICITFAST),
    "integrator implicit": _set(integrator=INTEGRATOR.mjINT_IMPLICIT),
    "solver PGS": _set(solver=SOLVER.mjSOL_PGS),
    "solver PGS, 5 iterations": _set(solver=SOLVER.mjSOL_PGS, iterations=5),
    "solver CG": _set(solver=SOLVER.mjSOL_CG),
    "solver Newton, 1 iteration": _set(iterations=1),
    "solver Newton, 5 steps of line search": _set(ls_iterations=5),
    "solver Newton, tolerance 1e-4": _set(tolerance=1e-4),
    "noslip, 3 iterations": _set(noslip_iterations=3),
    "elliptic cone": _set(cone=mujoco.mjtCone.mjCONE_ELLIPTIC),
    "sparse Jacobian": _set(jacobian=mujoco.mjtJacobian.mjJAC_SPARSE),
    "contacts without friction": _frictionless,
}


def option_rows(cases: Sequence[Case], evaluations: int, rounds: int) -> list[dict[str, str]]:
    """Try every option on some cases.

    Args:
        cases: The cases.
        evaluations: Evaluations of the dynamics in one run.
        rounds: Number of counted rounds.

    Returns:
        A row for every option: speed over the speed without the option, and the difference of the final
        angles in [rad] if there is one.
    """
    rows: dict[str, dict[str, str]] = {}
    for case in cases:
        ticks = max(1, evaluations // case.evaluations)
        bare = {name: BareSession(case, ticks) for name in (LIKE, *OPTIONS)}
        for name, change in OPTIONS.items():
            change(bare[name].model)
        many = {
            LIKE: RolloutSession(case, ticks),
            "rollout in one chunk": RolloutSession(case, ticks, chunk_size=WIDTH),
            "rollout without a pool": RolloutSession(case, ticks, threads=0, episodes=WIDTH),
            "mujoco.batch, which writes no states": StateBatchSession(case, ticks),
        }
        for sessions in (bare, many):
            times = time_in_turn({name: (session, 1) for name, session in sessions.items()}, rounds)
            ends = {name: session.last_position() for name, session in sessions.items()}
            for name in list(sessions)[1:]:
                gain, off = speed_ratio(times[LIKE], times[name]), np.abs(ends[name] - ends[LIKE]).max()
                cell = f"{gain:.2f}" + (f" ({off:.0e} rad)" if off > SAME_MOTION else "")
                rows.setdefault(name, {"option": name})[f"{case.scenario}, {case.step}"] = cell
    return list(rows.values())
