"""Evolution strategy that trains the policies of the gallery on random wearers.

Each generation draws directions in the space of the weights, and walks with one wearer for each direction,
once along and once against it. The weights move along the directions that improved the walk (T. Salimans et
al.: Evolution strategies as a scalable alternative to reinforcement learning, arXiv:1703.03864, 2017), with
the steps of Adam (D. P. Kingma, J. Ba: Adam, ICLR 2015). The weights are validated on wearers of their own,
and the best ones are kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait import __version__, load_experiment
from twin_gait.control.policy_parameters import PolicyParameters, parse_input, parse_output
from twin_gait.learn import VectorGaitEnv
from twin_gait.learn.actions import PolicyAction
from twin_gait.learn.policy import policy_outputs, write_policy

DECIMALS = 4  # decimals of the stored weights
VALIDATION = 1000  # seed of the first wearer of the validation
WEARERS = {
    "patient.mass_kg": (55.0, 95.0),
    "patient.height_m": (1.6, 1.9),
    "patient.both.hip.effort": (0.0, 1.0),
    "patient.both.knee.effort": (0.0, 1.0),
    "scenario.belt_speed_km_per_h": (1.2, 1.8),
    "plant.friction_ratio.hip": (0.7, 1.3),
    "plant.friction_ratio.knee": (0.7, 1.3),
}
PHASES = ("early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension")


@dataclass(frozen=True)
class Task:
    """A policy without weights, and its training."""

    policy: dict[str, Any]  # fields of the policy
    rewards: dict[str, float]  # weights of the reward terms
    duration: float  # length of an episode [s]
    generations: int
    seed: int
    pairs: int = 16  # mirrored pairs of perturbed weights in a generation
    validated: int = 10  # generations between two validations
    spread: float = 0.05  # standard deviation of the perturbed weights
    rate: float = 0.02  # step of a weight in the first generation; it falls to a tenth


TASKS = {
    "low_effort": Task(
        policy={
            "description": "Lowers the motor torques at nearly the tracking of the table, every 10 ms.",
            "inputs": (
                *("hip.angle_deg / 30", "hip.velocity_deg_per_s / 150"),
                *("knee.angle_deg / 30", "knee.velocity_deg_per_s / 150"),
                *("foot.load_bw / 1", "other.foot.load_bw / 1", "time_in_phase_s / 0.3"),
                *(f"phase.{name} / 1" for name in PHASES),
            ),
            "outputs": (
                *("hip.torque_Nm * 12", "knee.torque_Nm * 12"),
                *("hip.stiffness_share * 0.5", "knee.stiffness_share * 0.5"),
            ),
            "hidden_units": 12,
        },
        rewards={"tracking": 3.0, "device_effort": 2.0, "smoothness": 2.0, "load_peak": 1.0, "fall": 100.0},
        duration=8.0,
        generations=60,
        seed=3,
    ),
    "assist_as_needed": Task(
        policy={
            "description": "Adapts stiffness and damping from stride to stride: assist as needed.",
            "inputs": (
                *("hip.error_deg / 3", "knee.error_deg / 3"),
                *("last.hip.stiffness_share / 1", "last.hip.damping_share / 1"),
                *("last.knee.stiffness_share / 1", "last.knee.damping_share / 1"),
            ),
            "outputs": (
                *("hip.stiffness_share * 0.8", "hip.damping_share * 0.8"),
                *("knee.stiffness_share * 0.8", "knee.damping_share * 0.8"),
            ),
            "hidden_units": 8,
            "per_stride": True,
        },
        rewards={"tracking": 1.0, "device_effort": 1.0, "load_peak": 1.0, "fall": 100.0},
        duration=10.0,
        generations=50,
        spread=0.1,
        rate=0.05,
        seed=2,
        validated=5,
    ),
}


def policy_of(task: Task, name: str, weights: np.ndarray, training: str = "") -> PolicyParameters:
    """Return the policy of a task with some weights."""
    fields = task.policy | {
        "inputs": tuple(map(parse_input, task.policy["inputs"])),
        "outputs": tuple(map(parse_output, task.policy["outputs"])),
    }
    found = tuple(np.round(weights, DECIMALS).tolist())
    return PolicyParameters(**fields, name=name, weights=found, training=training)


def environment_of(task: Task, policy: PolicyParameters) -> VectorGaitEnv:
    """Return environments in which the actions are the outputs of a policy."""
    loaded = load_experiment("treadmill_guided", [f"duration_s={task.duration}"])
    control = replace(loaded.experiment.control, mode="policy", policy=policy)
    return VectorGaitEnv(
        2 * task.pairs,
        experiment=replace(loaded, experiment=replace(loaded.experiment, control=control)),
        action=PolicyAction(),
        observations={"policy_input": 1.0},
        rewards=task.rewards,
        randomise=WEARERS,
        dtype=np.float64,
    )


def fitness(
    envs: VectorGaitEnv, policy: PolicyParameters, weights: np.ndarray, seeds: list[int]
) -> np.ndarray:
    """Return the mean reward of an episode in each environment; the rewards after its end are 0."""
    observations, _ = envs.reset(seed=seeds)
    rewards, running, steps = np.zeros(len(seeds)), np.ones(len(seeds), dtype=bool), 0
    while running.any():
        observations, reward, ended, cut, _ = envs.step(policy_outputs(policy, observations, weights))
        rewards += np.where(running, reward, 0.0)
        running &= ~(ended | cut)
        steps += 1
    return rewards / steps


def train(task: Task, name: str) -> tuple[np.ndarray, list[dict[str, float]]]:
    """Return the weights with the best validation, and the curve of the training."""
    generator, pairs = np.random.default_rng(task.seed), task.pairs
    n_in, n_hidden, n_out = (
        len(task.policy["inputs"]), task.policy["hidden_units"], len(task.policy["outputs"]),
    )  # fmt: skip
    # Outputs of zero: the training begins with the table.
    hidden = generator.normal(0.0, 0.5, (n_in + 1) * n_hidden)
    weights = np.concatenate([hidden, np.zeros((n_hidden + 1) * n_out)])
    policy = policy_of(task, name, np.zeros_like(weights))
    envs = environment_of(task, policy)
    validation = list(range(VALIDATION, VALIDATION + envs.num_envs))
    mean, square, curve = np.zeros_like(weights), np.zeros_like(weights), list[dict[str, float]]()
    best, best_score = weights.copy(), -np.inf
    for generation in range(task.generations + 1):
        if generation % task.validated == 0 or generation == task.generations:
            score = float(np.mean(fitness(envs, policy, np.round(weights, DECIMALS), validation)))
            curve.append({"generation": generation, "validation": score})
            print(f"{name}: generation {generation}, validation {score:.4f}", flush=True)
            if score > best_score:
                best, best_score = weights.copy(), score
        directions = generator.normal(size=(pairs, len(weights)))
        seeds = generator.integers(2**31, size=pairs).tolist()
        both = np.concatenate([weights + task.spread * directions, weights - task.spread * directions])
        found = fitness(envs, policy, both, [*seeds, *seeds])
        gains = found[:pairs] - found[pairs:]
        slope = gains @ directions / (np.std(gains) + 1e-9) / pairs
        mean, square = 0.9 * mean + 0.1 * slope, 0.99 * square + 0.01 * slope**2
        corrected = mean / (1.0 - 0.9 ** (generation + 1)), square / (1.0 - 0.99 ** (generation + 1))
        rate = task.rate * (1.0 - 0.9 * generation / task.generations)
        weights = weights + rate * corrected[0] / (np.sqrt(corrected[1]) + 1e-8)
    return best, curve


def write_trained(task: Task, name: str, weights: np.ndarray, folder: Path) -> None:
    """Write a policy with its training into a file in a folder."""
    size = f"seed {task.seed}, {task.generations} generations of {2 * task.pairs} walks"
    training = f"examples/train_policies.py of twin_gait {__version__}, {size}"
    write_policy(policy_of(task, name, weights, training), folder / f"{name}.yaml")
