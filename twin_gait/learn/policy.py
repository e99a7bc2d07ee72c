"""Policies outside the simulation: their outputs for many episodes at once, and their files."""

from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.configuration.gait_table_file import SCHEMA_VERSION
from twin_gait.configuration.sections import section_of
from twin_gait.control.policy_parameters import PolicyParameters
from twin_gait.core.network import dense_layer
from twin_gait.files import write_atomically
from twin_gait.yaml12 import dump_yaml


def policy_outputs(
    network: PolicyParameters, inputs: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Compute the outputs of a policy, from -1 to 1, with the same bits as the controller.

    Args:
        network: Policy.
        inputs: Inputs by episode, and leg by leg, shape ``(n, n_legs * n_inputs)``.
        weights: Weights of all episodes, shape ``(n_weights,)``, or of each, shape ``(n, n_weights)``; those
            of the policy by default.

    Returns:
        Outputs by episode, leg by leg, shape ``(n, n_legs * n_outputs)``.
    """
    numbers: Any = list(np.asarray(network.weights if weights is None else weights, dtype=float).T)
    values: Any = list(np.asarray(inputs, dtype=float).reshape(len(inputs), -1, len(network.inputs)).T)
    split, units, count = network.hidden_count, network.hidden_units, len(network.outputs)
    hidden, outputs = [0.0] * units, [0.0] * count
    dense_layer(numbers[:split], values, len(values), hidden, 0, units)
    dense_layer(numbers[split:], hidden, units, outputs, 0, count)
    return np.array(outputs).T.reshape(len(inputs), -1)


def write_policy(network: PolicyParameters, path: Path) -> None:
    """Write a policy to a file, for ``control.policy``."""
    write_atomically(
        path, dump_yaml({"schema_version": SCHEMA_VERSION, **section_of(PolicyParameters).document(network)})
    )
