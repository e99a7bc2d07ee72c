"""Two policies, trained with an evolution strategy on random wearers and tested on others.

A policy is a small network that changes the setpoints of the gait table. The first one lowers the torques of
the motors while the legs follow healthy walking as before; it acts every 10 ms. The second one adapts
stiffness and damping of a leg from stride to stride to a wearer who helps: assist as needed. Both are compared
with the shipped table and the other controllers of ``twin-gait compare`` on wearers and pushes that the
training did not contain. Training takes ten minutes for each policy on one core; pages: docs/reference/learning.md,
docs/tutorials/train_a_controller.md.
"""

# %%
from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from gallery import read_options

from twin_gait import load_experiment
from twin_gait.control.controllers.policy import PolicyParameters, parse_input, parse_output
from twin_gait.learn import VectorGaitEnv
from twin_gait.learn.actions import PolicyAction
from twin_gait.learn.policy import policy_outputs, write_policy

form = read_options("train_policies", only={"default": "", "help": "the only policy to train"})
PAIRS = 16  # mirrored pairs of perturbed networks in a generation: 32 environments
DECIMALS = 4  # decimals of the stored weights
WEARERS = {
    "patient.mass_kg": (55.0, 95.0),
    "patient.height_m": (1.6, 1.9),
    "scenario.belt_speed_km_per_h": (1.2, 1.8),
    "plant.friction_ratio.hip": (0.7, 1.3),
    "plant.friction_ratio.knee": (0.7, 1.3),
}
PHASES = ("early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension")


@dataclass(frozen=True)
class Task:
    """A policy without weights, and its training."""

    policy: dict[str, Any]  # inputs, outputs and times of the policy
    rewards: dict[str, float]  # weights of the reward terms
    wearers: dict[str, Any]  # values drawn for each episode
    duration: float  # length of an episode [s]
    generations: int
    seed: int
    spread: float = 0.05  # standard deviation of the perturbed weights
    rate: float = 0.02  # step of the weights in a generation
    settings: list[str] = field(default_factory=list)  # further settings of the experiment


TASKS = {
    "low_effort": Task(
        policy={
            "description": "Lowers the torques of the motors at the tracking of the table, every 10 ms.",
            "inputs": [
                *("hip.angle_deg / 30", "hip.velocity_deg_per_s / 150"),
                *("knee.angle_deg / 30", "knee.velocity_deg_per_s / 150"),
                *("foot.load_bw / 1", "other.foot.load_bw / 1", "time_in_phase_s / 0.3"),
                *(f"phase.{name} / 1" for name in PHASES),
            ],
            "outputs": [
                *("hip.torque_Nm * 12", "knee.torque_Nm * 12"),
                *("hip.stiffness_share * 0.5", "knee.stiffness_share * 0.5"),
            ],
            "hidden_units": 12,
        },
        rewards={
            "tracking": 4.0, "device_effort": 2.0, "smoothness": 2.0, "load_peak": 2.0, "fall": 100.0,
        },
        wearers=WEARERS,
        duration=10.0,
        generations=300,
        seed=1,
    ),
    "assist_as_needed": Task(
        policy={
            "description": "Adapts stiffness and damping of the table from stride to stride: assist as needed.",
            "inputs": [
                *("hip.error_deg / 10", "knee.error_deg / 10"),
                *("last.hip.stiffness_share / 1", "last.hip.damping_share / 1"),
                *("last.knee.stiffness_share / 1", "last.knee.damping_share / 1"),
            ],
            "outputs": [
                *("hip.stiffness_share * 0.8", "hip.damping_share * 0.8"),
                *("knee.stiffness_share * 0.8", "knee.damping_share * 0.8"),
            ],
            "hidden_units": 8,
            "per_stride": True,
        },
        rewards={"tracking": 1.0, "device_effort": 1.0, "load_peak": 1.0, "fall": 100.0},
        wearers=WEARERS | {"patient.both.hip.effort": (0.0, 1.0), "patient.both.knee.effort": (0.0, 1.0)},
        duration=15.0,
        generations=200,
        seed=2,
    ),
}  # fmt: skip


# %% [markdown]
# ## Evolution strategy
# Each generation draws 16 directions in the space of the weights, and walks with 16 wearers once in each
# direction and once against it. The weights move along the directions that improved the walk (Salimans et al.
# 2017, arXiv:1703.03864), with the step sizes of Adam (Kingma, Ba 2015).


# %%
def experiment_of(task: Task, name: str, weights: np.ndarray | None = None) -> tuple[Any, PolicyParameters]:
    """Return the experiment and the policy of a task with some weights, zero by default."""
    parsed = {
        "inputs": tuple(map(parse_input, task.policy["inputs"])),
        "outputs": tuple(map(parse_output, task.policy["outputs"])),
    }
    values = {**task.policy, **parsed, "name": name}
    count = (len(parsed["inputs"]) + 1) * values["hidden_units"]
    count += (values["hidden_units"] + 1) * len(parsed["outputs"])
    found = np.zeros(count) if weights is None else weights
    policy = PolicyParameters(**values, weights=tuple(np.round(found, DECIMALS).tolist()))
    loaded = load_experiment("treadmill", [f"duration_s={task.duration}", *task.settings])
    control = replace(loaded.experiment.control, mode="policy", policy=policy)
    return replace(loaded, experiment=replace(loaded.experiment, control=control)), policy


def fitness(envs: VectorGaitEnv, policy: PolicyParameters, weights: np.ndarray, seeds: list[int]) -> np.ndarray:
    """Return the mean reward of an episode in each environment with its own weights, 0 after its end."""
    observations, _ = envs.reset(seed=seeds)
    rewards, running, steps = np.zeros(len(seeds)), np.ones(len(seeds), dtype=bool), 0
    while running.any():
        observations, reward, ended, cut, _ = envs.step(policy_outputs(policy, observations, weights))
        rewards += np.where(running, reward, 0.0)
        running &= ~(ended | cut)
        steps += 1
    return rewards / steps


def train(name: str, task: Task, generations: int) -> tuple[np.ndarray, list[float]]:
    """Return the weights and the mean fitness of each generation."""
    loaded, policy = experiment_of(task, name)
    envs = VectorGaitEnv(
        2 * PAIRS, experiment=loaded, action=PolicyAction(), observations={"policy_input": 1.0},
        rewards=task.rewards, randomise=task.wearers, dtype=np.float64,
    )  # fmt: skip
    generator = np.random.default_rng(task.seed)
    weights = np.zeros(len(policy.weights))
    weights[: policy.hidden_count] = generator.normal(0.0, 0.5, policy.hidden_count)
    mean, square, curve = np.zeros_like(weights), np.zeros_like(weights), list[float]()
    for generation in range(1, generations + 1):
        directions = generator.normal(size=(PAIRS, len(weights)))
        seeds = [int(number) for number in generator.integers(2**31, size=PAIRS)]
        both = np.concatenate([weights + task.spread * directions, weights - task.spread * directions])
        found = fitness(envs, policy, both, [*seeds, *seeds])
        gains = found[:PAIRS] - found[PAIRS:]
        slope = gains @ directions / (np.std(gains) + 1e-9) / PAIRS
        mean, square = 0.9 * mean + 0.1 * slope, 0.99 * square + 0.01 * slope**2
        corrected = mean / (1.0 - 0.9**generation), square / (1.0 - 0.99**generation)
        weights += task.rate * corrected[0] / (np.sqrt(corrected[1]) + 1e-8)
        curve.append(float(found.mean()))
        if generation % 20 == 0 or generation == generations:
            print(f"{name}: generation {generation}, fitness {np.mean(curve[-20:]):.4f}", flush=True)
    return weights, curve
