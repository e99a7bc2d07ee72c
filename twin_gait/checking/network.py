"""Rules on the CAN bus between the central unit and the boards: load, response times, ranges of values."""

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import NamedTuple

from twin_gait.checking.finding import CheckCase, Finding, Severity, rule
from twin_gait.core.can_frame import max_frame_bits
from twin_gait.core.control_tick import COLUMNS_PER_JOINT
from twin_gait.experiment.bus import bus_messages
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import TICK
from twin_gait.network.bus import cyclic_messages, new_bus
from twin_gait.parameters.network import ImpedanceLocation, NetworkParameters
from twin_gait.simulation.simulation_setup import SimulationSetup

# Units of the setpoints, in the order of a row of phases.
_SETPOINTS = {"stiffness": " N·m/rad", "damping": " N·m·s/rad", "equilibrium": " rad", "gain": ""}


class CyclicFrame(NamedTuple):
    """Timing of a cyclic frame for the analysis, all times in one unit."""

    transmission: int  # longest transmission time C, interframe space included
    period: int  # shortest time T between two of its events
    jitter: int = 0  # longest time J from an event until the frame is queued


def bus_load(frames: Sequence[CyclicFrame]) -> Fraction:
    r"""Compute the largest share of the time in which the bus is in use, :math:`\sum C_m / T_m`."""
    return sum((Fraction(frame.transmission, frame.period) for frame in frames), Fraction(0))


def response_times(frames: Sequence[CyclicFrame], bit: int) -> list[int | None]:
    r"""Compute the longest times from an event to the end of its frame.

    With :math:`B_m` the longest transmission of a lower priority, over the instances
    :math:`q = 0 \dots Q_m - 1` of the busy period :math:`t_m`:

    .. math::

        t_m &= B_m + \sum_{k \le m} \left\lceil \frac{t_m + J_k}{T_k} \right\rceil C_k, \qquad
        Q_m = \left\lceil \frac{t_m + J_m}{T_m} \right\rceil

        w_m(q) &= B_m + q\,C_m + \sum_{k < m} \left\lceil \frac{w_m + J_k + \tau_{bit}}{T_k} \right\rceil C_k

        R_m &= \max_q\; J_m + w_m(q) - q\,T_m + C_m

    ``frames``: the frames, highest priority first. ``bit``: length :math:`\tau_{bit}` of a bit, within which
    nodes begin at the same time. Returns :math:`R_m` of each frame; None if frames of its priority and above
    fill the bus.
    """
    return [_response_time(frames, number, bit) for number in range(len(frames))]


def _response_time(frames: Sequence[CyclicFrame], number: int, bit: int) -> int | None:
    frame, higher = frames[number], frames[:number]
    blocking = max((other.transmission for other in frames[number + 1 :]), default=0)
    if bus_load(frames[: number + 1]) >= 1:
        return None
    busy = _settled(frame.transmission, blocking, [*higher, frame], 0)
    longest, waiting = 0, 0
    for instance in range(-(-(busy + frame.jitter) // frame.period)):
        waiting = _settled(waiting, blocking + instance * frame.transmission, higher, bit)
        longest = max(longest, frame.jitter + waiting - instance * frame.period + frame.transmission)
    return longest


def _settled(start: int, constant: int, frames: Sequence[CyclicFrame], bit: int) -> int:
    """Find the least fixed point, at or above a start, of a constant plus the time that the frames take."""
    time, longer = start, -1
    while time != longer:
        longer = time
        time = constant + sum(
            -(-(longer + item.jitter + bit) // item.period) * item.transmission for item in frames
        )
    return time


def traffic_of(experiment: Experiment) -> tuple[float, dict[str, float]]:
    """Compute the largest load of the healthy bus of an experiment, with all possible stuff bits.

    ``experiment``: experiment with a network. Returns the share of the time in which the bus is in use, and
    for each frame by its name the longest time in [s] from the instant at which it is due to its arrival;
    infinite if the bus is full.
    """
    network, messages = experiment.network or NetworkParameters(), bus_messages(experiment)
    boards = [f"{side}_{joint}" for side in experiment.sides for joint in experiment.joints]
    bus = new_bus(network, messages, boards, 0, TICK)
    frames = [
        CyclicFrame(max_frame_bits(frame.header.length) * bus.bit, frame.period, frame.jitter)
        for frame in bus.frames
    ]
    times = [math.inf if time is None else 1e-12 * time for time in response_times(frames, bus.bit)]
    names = [message.name for message in cyclic_messages(messages, boards)]
    return float(bus_load(frames)), dict(zip(names, times, strict=True))


@rule
def bus_traffic(case: CheckCase) -> Iterator[Finding]:
    """Find a bus load above the capacity, and frames that may arrive after the next one is due.

    Reports load and response times as a note if the bus carries all frames. The bounds are those of Davis,
    Burns, Bril and Lukkien (2007), for a healthy bus.
    """
    if case.experiment is None or case.experiment.network is None:
        return
    network = case.experiment.network
    load, times = traffic_of(case.experiment)
    last = max(times, key=lambda name: times[name])
    reason = (
        f"network.bit_rate_kbit_per_s {1e-3 * network.bit_rate:g}: {len(times)} frames every "
        f"{1e3 * network.cycle:g} ms are {load:.0%} of the capacity of the bus; the last one, {last}, "
        f"arrives up to {1e3 * times[last]:.3f} ms after it is due"
    )
    if times[last] <= network.cycle:
        yield Finding(Severity.NOTE, reason, "")
    else:
        suggestion = "raise network.bit_rate_kbit_per_s or network.cycle_ms, or lower network.jitter_us"
        yield Finding(Severity.ERROR, reason, suggestion)


@rule
def bus_value_range(case: CheckCase) -> Iterator[Finding]:
    """Find values of the experiment outside the range of their signal on the bus, which would be clipped."""
    if case.experiment is None or case.experiment.network is None:
        return
    problem, messages = case.setup, bus_messages(case.experiment)
    suggestion = "choose a value within the range, or a DBC file with a wider range"
    found: dict[str, str] = {}  # reason by key, because both legs have the same keys
    for number, joint in enumerate(problem.joints):
        for key, value, unit, kind, signal in _bus_values(problem, case.experiment.network, number):
            message = f"{joint.side}_{joint.joint}_{kind}"
            low, high = messages[message].bounds(signal)
            if not low <= value <= high:
                room = f"outside {low:.6g} to {high:.6g}{unit}, the range of {message}.{signal}"
                found.setdefault(key, f"{key}: {value:.6g}{unit} is {room}")
    yield from (Finding(Severity.ERROR, reason, suggestion) for reason in found.values())


def _bus_values(
    setup: SimulationSetup, network: NetworkParameters, number: int
) -> Iterator[tuple[str, float, str, str, str]]:
    """Yield the values of a joint that the bus carries: key, value, unit, kind of message, signal.

    These are the limits of torque and current, the latter at the trip of the monitor, the damping of the
    hold, target torques, and k, b, θ0 and G of every phase as they are driven. Stiffness and damping are left
    out if the control unit computes the impedance.
    """
    joint, control = setup.joints[number], setup.experiment.control
    limits, equal = control.limits[joint.joint], len(set(control.limits.values())) == 1
    section = "control.limits" if equal else f"control.limits.{joint.joint}"
    trip = control.safety.current_share * limits.current
    for sign in (1.0, -1.0):
        yield f"{section}.torque_Nm", sign * limits.torque, " N·m", "setpoint", "torque"
        key = f"{section}.current_A times control.safety.current_share"
        yield key, sign * trip, " A", "measurement", "current"
    damping = control.safety.hold_damping
    yield "control.safety.hold_damping_Nms_per_rad", damping, " N·m·s/rad", "setpoint", "damping"
    target = control.target_torque.get(joint.joint, 0.0)
    yield f"control.target_torque_Nm.{joint.joint}", target, " N·m", "setpoint", "torque"
    leg, position = divmod(number, setup.joints_per_leg)
    columns = setup.phase_rows[leg, :, position * COLUMNS_PER_JOINT : (position + 1) * COLUMNS_PER_JOINT]
    for phase, row in zip(setup.table.phase_names, columns.tolist(), strict=True):
        for (signal, unit), value in zip(_SETPOINTS.items(), row, strict=True):
            if network.impedance is not ImpedanceLocation.CCU or signal not in ("stiffness", "damping"):
                yield f"table.phases.{phase}.{joint.joint}: {signal}", value, unit, "setpoint", signal


RULES = (bus_traffic, bus_value_range)
