"""Dense layers of small neural networks, with an activation that needs no exponential.

A layer adds in a fixed order, so that Python, compiled code and C give the same bits. With arrays as numbers,
the same function evaluates many networks at once, entry by entry.
"""


def softsign(value: float) -> float:
    """Compute the activation x / (1 + abs(x)), a number between -1 and 1."""
    return value / (1.0 + abs(value))


def dense_layer(
    weights: list[float], inputs: list[float], n_inputs: int, outputs: list[float], first: int, n_outputs: int
) -> None:
    r"""Evaluate :math:`y_j = \sigma(b_j + \sum_i w_{ji} x_i)` with the softsign :math:`\sigma`.

    Args:
        weights: For each output its bias b, then its weight w of each input.
        inputs: Inputs x.
        n_inputs: Number of inputs.
        outputs: List into which the outputs y are written.
        first: Index of the first output in this list.
        n_outputs: Number of outputs.
    """
    for number in range(n_outputs):
        bias = number * (n_inputs + 1)
        total = weights[bias]
        for index in range(n_inputs):
            total = total + weights[bias + 1 + index] * inputs[index]  # not in place: weights may be arrays
        outputs[first + number] = softsign(total)
