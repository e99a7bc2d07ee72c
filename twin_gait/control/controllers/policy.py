"""Policy: a small neural network that changes the setpoints of the gait table, as found by training.

Each leg has its own inputs and outputs of the same network. At the end of every control step the network
computes outputs from -1 to 1, and each output, times its bound, changes a quantity of a joint. The outputs
move towards their new values with a limited rate from the next tick on.
"""

from dataclasses import dataclass, field

import numpy as np

from twin_gait.control.controller import (
    PATH_SAMPLES,
    Controller,
    Plan,
    StrideClock,
    begin_stride,
    find_cycle_interval,
    stride_progress,
)
from twin_gait.control.gait_controller import N_JOINTS_PER_LEG, ControllerState
from twin_gait.control.policy_parameters import ERROR, LAST, PHASE, QUANTITIES, PolicyParameters
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.core.network import dense_layer
from twin_gait.gait.signals import OTHER, all_signal_names, signal_names, signal_scale
from twin_gait.gait.table import TICK
from twin_gait.parameters.quantities import DEGREE, require
from twin_gait.vocabulary import JointName, Side

MOST_INPUT = 1e6  # Largest input of the network; beyond it a measurement counts as missing, which is 0.
SIGNAL_INPUT, PHASE_INPUT, ERROR_INPUT, LAST_INPUT = range(4)  # Kinds of inputs.


@dataclass(slots=True)
class PolicyMemory:
    """State of a policy; entries of a leg are next to each other, the left leg first."""

    period: int  # Control step in ticks.
    step: float  # Largest change of an output in a tick.
    per_stride: bool  # Whether a leg computes new outputs only when it begins a stride.
    kinds: list[int]  # Kind of each input.
    sources: list[int]  # Index of each input among those of its kind, by leg.
    factors: list[float]  # Factor of each input.
    joints: list[int]  # Joint of each output, counted in its leg.
    columns: list[int]  # Quantity of each output, as a column of a setpoint.
    bounds: list[float]  # Largest change of each output in SI.
    hidden_weights: list[float]  # Weights of the hidden layer.
    output_weights: list[float]  # Weights of the outputs.
    path: list[float]  # Angles of healthy walking in [rad], by sample (``PATH_SAMPLES``) and joint of a leg.
    strides: list[StrideClock]  # Strides of the legs.
    error_sums: list[float]  # Sum of the absolute errors in the present stride in [rad], by joint.
    errors: list[float]  # Mean absolute error of the last stride in [rad], by joint.
    due: list[bool]  # Whether a leg computes new outputs at the end of this control step.
    leg_inputs: list[float]  # Inputs of the leg that is being computed.
    inputs: list[float]  # Inputs at the end of the last control step, by leg.
    hidden: list[float]  # Values of the hidden units.
    outputs: list[float]  # Outputs of the network, by leg.
    applied: list[float]  # Outputs that act in this tick, by leg.


def policy_tick(memory: PolicyMemory, device: ControllerState, tick: int, period: float) -> None:
    """Apply the outputs of both legs, and compute new ones at the end of a control step."""
    for number in range(len(device.legs)):
        track_stride(memory, device, number, tick)
        apply_outputs(memory, device, number)
        if (tick + 1) % memory.period == 0 and memory.due[number]:
            compute_outputs(memory, device, number)


def track_stride(memory: PolicyMemory, device: ControllerState, number: int, tick: int) -> None:
    """Add the errors of this tick, and take their means of a stride that has ended."""
    leg, first, clock = device.legs[number], number * N_JOINTS_PER_LEG, memory.strides[number]
    if tick > 0 and leg.phase == 0 and leg.entry_tick == tick:
        duration = begin_stride(clock, tick)
        memory.due[number] = True
        for index in range(first, first + N_JOINTS_PER_LEG):
            memory.errors[index] = memory.error_sums[index] / duration
            memory.error_sums[index] = 0.0
    before, share = find_cycle_interval(stride_progress(clock, tick), PATH_SAMPLES)
    for position in range(N_JOINTS_PER_LEG):
        start = memory.path[before * N_JOINTS_PER_LEG + position]
        end = memory.path[(before + 1) * N_JOINTS_PER_LEG + position]
        error = device.joints[first + position].measurement.angle - (start + share * (end - start))
        memory.error_sums[first + position] += abs(error)


def read_input(memory: PolicyMemory, device: ControllerState, number: int, index: int) -> float:
    """Return an input of a leg in SI, before its factor."""
    kind, source = memory.kinds[index], memory.sources[number * len(memory.kinds) + index]
    if kind == PHASE_INPUT:
        return 1.0 if device.legs[number].phase == source else 0.0
    if kind == ERROR_INPUT:
        return memory.errors[number * N_JOINTS_PER_LEG + source]
    if kind == LAST_INPUT:
        return memory.outputs[number * len(memory.columns) + source]
    return device.signals[source]


def compute_outputs(memory: PolicyMemory, device: ControllerState, number: int) -> None:
    """Read the inputs of a leg, and compute its outputs."""
    n_inputs, n_outputs = len(memory.kinds), len(memory.columns)
    for index in range(n_inputs):
        value = memory.factors[index] * read_input(memory, device, number, index)
        value = value if abs(value) <= MOST_INPUT else 0.0  # NaN or infinity would remain in the outputs.
        memory.leg_inputs[index] = value
        memory.inputs[number * n_inputs + index] = value
    hidden, first = memory.hidden, number * n_outputs
    dense_layer(memory.hidden_weights, memory.leg_inputs, n_inputs, hidden, 0, len(hidden))
    dense_layer(memory.output_weights, hidden, len(hidden), memory.outputs, first, n_outputs)
    memory.due[number] = not memory.per_stride


def apply_outputs(memory: PolicyMemory, device: ControllerState, number: int) -> None:
    """Move the outputs of a leg towards those of the network, and change the setpoints of its joints."""
    for index in range(len(memory.columns)):
        place = number * len(memory.columns) + index
        last = memory.applied[place]
        value = min(max(memory.outputs[place], last - memory.step), last + memory.step)
        memory.applied[place] = value
        setpoint = device.joints[number * N_JOINTS_PER_LEG + memory.joints[index]].setpoint
        column, change = memory.columns[index], memory.bounds[index] * value
        if column == STIFFNESS:
            setpoint.stiffness *= 1.0 + change
        elif column == DAMPING:
            setpoint.damping *= 1.0 + change
        elif column == GAIN:
            setpoint.gain *= 1.0 + change
        elif column == EQUILIBRIUM:
            setpoint.equilibrium += change
        else:
            setpoint.target += change


@dataclass(frozen=True)
class Policy(Controller):
    """The phases of the gait table, whose setpoints a network changes."""

    policy: PolicyParameters | None = field(default=None)  # Network.

    mode = "policy"
    tick = staticmethod(policy_tick)

    @property
    def network(self) -> PolicyParameters:
        """Network, which :meth:`check_joints` requires."""
        assert self.policy is not None
        return self.policy

    def check_joints(self, joints: tuple[JointName, ...]) -> str:
        """Check that there is a network, and that its outputs and errors are those of driven joints."""
        if self.policy is None:
            problem = "is missing; control.mode policy needs a network: the name or the file of a policy"
            return f"control.policy: {problem}"
        named = [str(item.joint) for item in self.network.outputs]
        named += [name.removesuffix(ERROR) for name in self.network.input_names if name.endswith(ERROR)]
        missing = [name for name in named if name not in joints]
        return f"control.policy: has no {missing[0]} to read or change; use another policy" if missing else ""

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """Return the setpoints of the table; raise ParameterError for an input that the device lacks."""
        _sources(self.network, plan)
        return rows

    def initial_memory(self, plan: Plan) -> PolicyMemory:
        """Create the memory: outputs of zero, and the healthy walk for the tracking errors."""
        network, reference, legs = self.network, plan.reference, len(plan.sides)
        found = _sources(network, plan)
        split, n_joints = network.hidden_count, legs * len(plan.joints)
        n_inputs, n_outputs = len(network.inputs), len(network.outputs)
        quantities = [QUANTITIES[item.quantity] for item in network.outputs]
        units = [unit for _, unit, _ in quantities]
        return PolicyMemory(
            period=network.period_ticks,
            step=TICK / network.ramp,
            per_stride=network.per_stride,
            kinds=[kind for kind, _, _ in found],
            sources=[places[leg] for leg in range(legs) for _, places, _ in found],
            factors=[scale / item.divisor for (_, _, scale), item in zip(found, network.inputs, strict=True)],
            joints=[plan.joints.index(item.joint) for item in network.outputs],
            columns=[column for column, _, _ in quantities],
            bounds=[unit * item.bound for unit, item in zip(units, network.outputs, strict=True)],
            hidden_weights=list(network.weights[:split]),
            output_weights=list(network.weights[split:]),
            path=[angle for row in reference.angles for angle in row],
            strides=[StrideClock(reference.cycle_ticks, start) for start in reference.starts],
            error_sums=[0.0] * n_joints,
            errors=[0.0] * n_joints,
            due=[True] * legs,
            leg_inputs=[0.0] * n_inputs,
            inputs=[0.0] * (legs * n_inputs),
            hidden=[0.0] * network.hidden_units,
            outputs=[0.0] * (legs * n_outputs),
            applied=[0.0] * (legs * n_outputs),
        )


def _sources(network: PolicyParameters, plan: Plan) -> list[tuple[int, list[int], float]]:
    """Return the sources of all inputs; raise ParameterError for an input that the device lacks."""
    return [_source(name, network, plan) for name in network.input_names]


def _source(name: str, network: PolicyParameters, plan: Plan) -> tuple[int, list[int], float]:
    """Return kind of an input, its index for each leg, and the factor from SI to its unit."""
    signals, own = all_signal_names(plan.joints), len(signal_names(plan.joints))
    legs = len(plan.sides)
    if name.startswith(PHASE) and name.removeprefix(PHASE) in plan.phases:
        return PHASE_INPUT, [plan.phases.index(name.removeprefix(PHASE))] * legs, 1.0
    if name.endswith(ERROR) and name.removesuffix(ERROR) in plan.joints:
        return ERROR_INPUT, [plan.joints.index(name.removesuffix(ERROR))] * legs, 1.0 / DEGREE
    if name.startswith(LAST) and name.removeprefix(LAST) in network.output_names:
        return LAST_INPUT, [network.output_names.index(name.removeprefix(LAST))] * legs, 1.0
    known = [item for item in signals if legs == 2 or not item.startswith(OTHER)]
    expected = f"a signal, one of {', '.join(known)}, {PHASE}NAME, JOINT{ERROR} or {LAST}JOINT.QUANTITY"
    require(name in known, "control.policy.inputs", expected, name)
    # The list of signals has those of the last leg, whose guards were evaluated last, then of the other leg.
    index = signals.index(name)
    swapped = (index + own) % (2 * own) if index < 2 * own else index
    places = [index if leg == legs - 1 else swapped for leg in range(legs)]
    return SIGNAL_INPUT, places, 1.0 / signal_scale(name)
