"""Steps per second of the learning environments, Gymnasium's own vector environment and MuJoCo's rollout.

All run on one core in one process and in turn. MuJoCo simulates the same legs on the same ground with the
same integrator and step, open loop and without observations: the cost of the physics alone. The script takes
about two minutes, more if loops have to be compiled.
"""

# %%
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "examples"))

from gallery import read_options

try:
    import gymnasium
    import numpy as np
    from peers.mujoco_peers import RolloutSession
    from peers.scenarios import cases
    from peers.timing import instruction_set, machine

    from twin_gait import load_experiment
    from twin_gait.learn import GaitEnv, VectorGaitEnv
    from twin_gait.learn.episodes import make_records
    from twin_gait.simulation.compiled_engine import CompiledEngine
    from twin_gait.simulation.simulation_setup import build_setup
except ImportError:
    sys.exit("needs Gymnasium and MuJoCo 4, which pip install 'twin-gait[test]' brings")

ENVIRONMENTS, STEP_TICKS, GOAL = 32, 10, 100_000
TREADMILL = [case for case in cases() if case.scenario == "treadmill"][-1]


def environment() -> GaitEnv:
    """Return an environment of an episode that the measurement does not end."""
    return GaitEnv(duration_s=3600.0)


def vector_steps(envs: gymnasium.vector.VectorEnv) -> Callable[[int], int]:
    """Return a function that runs some steps with random actions and returns the number of all steps."""
    envs.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (64, *envs.action_space.shape))

    def run(steps: int) -> int:
        for number in range(steps):
            envs.step(actions[number % len(actions)])
        return steps * envs.num_envs

    return run


def tick_steps() -> Callable[[int], int]:
    """Return a function that runs the ticks of the vector environment, without actions and rewards."""
    setup = build_setup(load_experiment("treadmill_guided", ["duration_s=3600"]).experiment)
    engines = [CompiledEngine(setup) for _ in range(ENVIRONMENTS)]
    for engine in engines:
        engine.episode["recording"]["on"] = False
    records = make_records(engines, STEP_TICKS)

    def run(steps: int) -> int:
        for _ in range(steps):
            records.advance(np.arange(ENVIRONMENTS))
        return steps * ENVIRONMENTS

    return run


def single_steps() -> Callable[[int], int]:
    """Return a function that runs some steps of a single environment."""
    env = environment()
    env.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (64, 4))

    def run(steps: int) -> int:
        for number in range(steps):
            env.step(actions[number % len(actions)])
        return steps

    return run


def rollout_steps() -> Callable[[int], int]:
    """Return a function that runs MuJoCo's rollout of the same legs for some control steps."""
    session = RolloutSession(TREADMILL, STEP_TICKS, episodes=ENVIRONMENTS)

    def run(steps: int) -> int:
        for _ in range(steps):
            session.run()
        return steps * ENVIRONMENTS

    return run


# %% [markdown]
# One round runs each implementation once, so that other load on the machine affects all of them alike.

# %%
if __name__ == "__main__":
    form = read_options("learning", Path(__file__).parent)
    steps, rounds = (5, 2) if form.quick else (200, 15)
    runs = {
        "vector environment": vector_steps(VectorGaitEnv(ENVIRONMENTS, duration_s=3600.0)),
        "ticks of the vector environment alone": tick_steps(),
        "single environment": single_steps(),
        "SyncVectorEnv of single ones": vector_steps(
            gymnasium.vector.SyncVectorEnv([environment] * ENVIRONMENTS)
        ),
        "MuJoCo rollout, physics alone": rollout_steps(),
    }
    fastest = dict.fromkeys(runs, 0.0)
    for _ in range(rounds):
        for name, run in runs.items():
            began = time.process_time()
            done = run(steps)
            fastest[name] = max(fastest[name], done / (time.process_time() - began))
    rows = [{"implementation": name, "steps per second": round(rate)} for name, rate in fastest.items()]
    for row in rows:
        print(f"{row['implementation']:38} {row['steps per second']:9,} steps of 10 ms per second and core")
    form.write_results({"rows": rows, "goal": GOAL, "vectors": instruction_set(), "machine": machine()})
