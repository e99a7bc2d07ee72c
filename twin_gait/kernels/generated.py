"""Write the rigid-body dynamics of one model as straight-line Python.

The generic algorithms of :mod:`twin_gait.kernels.rigid_body` run once over symbols. Topology, axes and
structural zeros are folded into the text; masses, inertias, lengths and armature stay inputs, so that
another wearer needs no new kernel.

Straight-line code runs five to ten times faster than loops, but its text grows with the square of the number
of joints, and the time to compile it faster still: models of more than :data:`STRAIGHT_LINE_LIMIT` joints are
refused.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import fields
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from twin_gait.core.contact import Point, ground_contact_force, sloped_contact_force
from twin_gait.core.elementary import sine_cosine
from twin_gait.exceptions import ModelError
from twin_gait.kernels import rigid_body
from twin_gait.kernels.rigid_body import Vector, vector
from twin_gait.kernels.tracing import Scalar, Trace, compact, text, together
from twin_gait.leg_model.bodies import BodyArrays, ContactPoint

# Joints. Its function dynamics alone compiles in 0.5 s for 2 joints, 14 s for 16 and 100 s for 32. Two legs
# with ankles on a pelvis in a harness have 8, and with a wearer in braces 16.
STRAIGHT_LINE_LIMIT = 16

POINT_FIELDS = tuple(item.name for item in fields(Point))


class Called(NamedTuple):
    """A function that kernels call for several things at once, which may become vectors."""

    function: Callable[..., tuple[float, ...]]  # Of one of them.
    shared: int  # Arguments that all have in common; they come first.
    arguments: int  # Of each.
    results: int  # Of each.

    @property
    def name(self) -> str:
        """In the text."""
        return self.function.__name__


SIDE_BY_SIDE = Called(sine_cosine, 0, 1, 2), Called(ground_contact_force, 1, 3, 2)

# Of a guide: part of the joint's wrench and axis, pitching moment and forward force.
WRENCH = (0, 1), (1, 0)


def _map_values(
    bodies: Sequence[BodyArrays], points: Sequence[ContactPoint], visit: Callable[[float], Scalar]
) -> tuple[list[BodyArrays], list[ContactPoint]]:
    """Rebuild bodies and contact points with every run-time value passed through a function."""
    mapped = []
    for body in bodies:
        inertia = np.full((3, 3), 0.0, dtype=object)
        for i in range(3):
            for j in range(i, 3):
                inertia[i, j] = inertia[j, i] = visit(body.inertia[i][j])
        mapped.append(
            body._replace(
                axis=vector(body.axis),
                rotation=vector(body.rotation),
                position=vector([visit(value) for value in body.position]),
                mass=visit(body.mass),
                first_moment=vector([visit(value) for value in body.first_moment]),
                inertia=inertia,
                armature=visit(body.armature),
            )
        )
    moved = [vector([visit(value) for value in point.position]) for point in points]
    return mapped, [point._replace(position=position) for point, position in zip(points, moved, strict=True)]


def body_values(bodies: Sequence[BodyArrays], points: Sequence[ContactPoint] = ()) -> list[float]:
    """Run-time inputs of a kernel, in the order in which it reads them; structural zeros left out."""
    values: list[float] = []

    def visit(value: float) -> float:
        if value != 0.0:
            values.append(value)
        return value

    _map_values(bodies, points, visit)
    return values


def _as_inputs(
    trace: Trace, bodies: Sequence[BodyArrays], points: Sequence[ContactPoint]
) -> tuple[list[BodyArrays], list[ContactPoint]]:
    count = 0

    def visit(value: float) -> Scalar:
        nonlocal count
        if value == 0.0:
            return 0.0
        count += 1
        return trace.input(f"bodies[{count - 1}]")

    return _map_values(bodies, points, visit)


def _inputs(trace: Trace, name: str, count: int) -> Vector:
    return vector([trace.input(f"{name}[{index}]") for index in range(count)])


def _gravity_vector(trace: Trace, up_axis: str) -> Vector:
    down = -trace.input("gravity")
    return vector([0.0, 0.0, down] if up_axis == "z" else [0.0, down, 0.0])


def _ground(trace: Trace, heights: list[Scalar], powers: list[Scalar], sloped: bool) -> rigid_body.ContactLaw:
    """Contact law that calls the one in core, and keeps heights and powers."""
    sine: Any = trace.input("ground.slope_sine")
    cosine: Any = trace.input("ground.slope_cosine")

    def press(*state: Any) -> Any:
        return trace.call("ground_contact_force", [trace.input("ground"), *state], 2)

    def law(number: int, position: Vector, velocity: Vector) -> list[Scalar]:
        place, speed = (position[0], position[2]), (velocity[0], velocity[2])
        height = place[1]
        if sloped:
            forward, upward, height = sloped_contact_force(sine, cosine, place, speed, press)
        else:
            forward, upward = press(height, *speed)
        heights.append(height)
        powers.append(forward * velocity[0] + upward * velocity[2])
        return [forward, upward]

    return law


def _total(values: Sequence[Scalar]) -> Scalar:
    total: Scalar = 0.0
    for value in values:
        total = value + total
    return total


def _function(
    signature: str, trace: Trace, stores: Sequence[tuple[str, Scalar]], returned: Sequence[Scalar]
) -> str:
    outputs = [value for _, value in stores] + list(returned)
    body = trace.live_lines(outputs)
    for item in SIDE_BY_SIDE:
        body = together(body, item.name, item.shared)
    body = compact(body, {text(value) for value in outputs})
    lines = [f"def {signature}:", *(f"    {line}" for line in body)]
    lines += [f"    {place} = {text(value)}" for place, value in stores]
    if returned:
        lines.append(f"    return {', '.join(text(value) for value in returned)}")
    if len(lines) == 1:
        lines.append("    pass")
    return "\n".join(lines) + "\n"


def _stores(name: str, values: Sequence[Scalar]) -> list[tuple[str, Scalar]]:
    return [(f"{name}[{index}]", value) for index, value in enumerate(values)]


def _point_stores(
    contacts: Sequence[Sequence[Scalar]], heights: Sequence[Scalar]
) -> list[tuple[str, Scalar]]:
    stores = []
    for number, (forces, height) in enumerate(zip(contacts, heights, strict=True)):
        parts = zip(POINT_FIELDS, [*forces, height], strict=True)
        stores += [(f"points[{number}].{name}", value) for name, value in parts]
    return stores


def write_dynamics(
    bodies: Sequence[BodyArrays], points: Sequence[ContactPoint], up_axis: str, sloped: bool = False
) -> str:
    """Source of ``dynamics``; see :mod:`twin_gait.simulation.interface`."""
    trace, heights, powers = Trace(), list[Scalar](), list[Scalar]()
    inputs, places = _as_inputs(trace, bodies, points)
    n = len(bodies)
    acceleration, contacts = rigid_body.forward_dynamics(
        inputs,
        _inputs(trace, "q", n),
        _inputs(trace, "v", n),
        _inputs(trace, "torque", n),
        _gravity_vector(trace, up_axis),
        places,
        _ground(trace, heights, powers, sloped),
    )
    stores = _stores("a", acceleration) + _point_stores(contacts, heights)
    signature = "dynamics(q, v, torque, bodies, gravity, ground, a, points)"
    return _function(signature, trace, stores, [_total(powers)])


def write_contact_forces(
    bodies: Sequence[BodyArrays], points: Sequence[ContactPoint], sloped: bool = False
) -> str:
    """Source of ``contact_forces``."""
    trace, heights, powers = Trace(), list[Scalar](), list[Scalar]()
    inputs, places = _as_inputs(trace, bodies, points)
    n = len(bodies)
    result = rigid_body.inverse_dynamics(
        inputs,
        _inputs(trace, "q", n),
        _inputs(trace, "v", n),
        [0.0] * n,
        rigid_body.ZERO,
        places,
        _ground(trace, heights, powers, sloped),
    )
    stores = _point_stores(result.contacts, heights)
    return _function("contact_forces(q, v, bodies, ground, points)", trace, stores, [_total(powers)])


def write_observe(
    bodies: Sequence[BodyArrays], points: Sequence[ContactPoint], up_axis: str, guides: Sequence[int] = (0,)
) -> str:
    """Source of ``observe``; the wrench is that of all guides, each about its own origin."""
    trace = Trace()
    inputs, places = _as_inputs(trace, bodies, points)
    n = len(bodies)
    q, v, a = (_inputs(trace, name, n) for name in ("q", "v", "a"))
    gravity = _gravity_vector(trace, up_axis)

    def known_force(number: int, position: Vector, velocity: Vector) -> list[Scalar]:
        return [trace.input(f"points[{number}].{name}") for name in POINT_FIELDS[:2]]

    result = rigid_body.inverse_dynamics(inputs, q, v, a, gravity, places, known_force)
    potential = rigid_body.potential_energy(inputs, q, gravity)
    moment, force = (
        _total([result.wrenches[guide][part][axis] for guide in guides]) for part, axis in WRENCH
    )
    returned = [result.kinetic_energy, potential, force, moment]
    return _function("observe(q, v, a, bodies, gravity, points)", trace, [], returned)


def write_control_gravity(bodies: Sequence[BodyArrays], up_axis: str) -> str:
    """Source of ``control_gravity``."""
    trace = Trace()
    inputs, _ = _as_inputs(trace, bodies, ())
    n = len(bodies)
    zeros: list[Scalar] = [0.0] * n
    result = rigid_body.inverse_dynamics(
        inputs, _inputs(trace, "q", n), zeros, zeros, _gravity_vector(trace, up_axis)
    )
    return _function(
        "control_gravity(q, bodies, gravity, torque)", trace, _stores("torque", result.torques), []
    )


def write_control_inertia(bodies: Sequence[BodyArrays]) -> str:
    """Source of ``control_inertia``."""
    trace = Trace()
    inputs, _ = _as_inputs(trace, bodies, ())
    n = len(bodies)
    a = _inputs(trace, "a", n)
    matrix = rigid_body.joint_space_inertia(inputs, _inputs(trace, "q", n))
    torques = [vector(row) @ a for row in matrix]
    return _function("control_inertia(q, a, bodies, torque)", trace, _stores("torque", torques), [])


class KernelBodies(NamedTuple):
    """What a kernel is written for."""

    bodies: Sequence[BodyArrays]
    points: Sequence[ContactPoint]  # Of the plant, that may touch the ground.
    control_bodies: Sequence[BodyArrays]
    up_axis: str  # ``"z"`` or ``"y"``.
    guides: Sequence[int] = (0,)
    sloped: bool = False  # Whether the ground may rise forwards; else it is level and nothing is turned.


def write_kernel(kernel: KernelBodies) -> str:
    """Source of all functions of :mod:`twin_gait.simulation.interface` for one structure.

    It needs the functions of :data:`SIDE_BY_SIDE` in its module.
    """
    bodies, points, control_bodies, up_axis, guides, sloped = kernel
    functions = [
        write_dynamics(bodies, points, up_axis, sloped),
        write_contact_forces(bodies, points, sloped),
        write_observe(bodies, points, up_axis, guides),
        write_control_gravity(control_bodies, up_axis),
        write_control_inertia(control_bodies),
    ]
    return "\n\n".join([*write_side_by_side("".join(functions)), *functions])


def write_side_by_side(text: str) -> list[str]:
    """Source of what the text of a kernel calls for several things at once: one thing after the other."""
    found = []
    for item in SIDE_BY_SIDE:
        for count in sorted({int(number) for number in re.findall(rf"\b{item.name}_(\d+)\(", text)}):
            common = [f"c{k}" for k in range(item.shared)]
            own = [[f"a{number}_{k}" for k in range(item.arguments)] for number in range(count)]
            results = [[f"r{number}_{k}" for k in range(item.results)] for number in range(count)]
            lines = [f"def {item.name}_{count}({', '.join([*common, *chain(*own)])}):"]
            for left, right in zip(results, own, strict=True):
                lines.append(f"    {', '.join(left)} = {item.name}({', '.join(common + right)})")
            lines.append(f"    return {', '.join(chain(*results))}")
            found.append("\n".join(lines) + "\n")
    return found


def kernel_structure(kernel: KernelBodies) -> str:
    """What the text of :func:`write_kernel` depends on; it takes a hundredth of the time to write that.

    Raises ModelError if the plant has more than :data:`STRAIGHT_LINE_LIMIT` joints.
    """
    bodies, points, control_bodies, up_axis, guides, sloped = kernel
    if len(bodies) > STRAIGHT_LINE_LIMIT:
        raise ModelError(
            f"the model has {len(bodies)} joints, those in braces counted twice, and the compiled engine "
            f"takes at most {STRAIGHT_LINE_LIMIT}; use engine: pinocchio"
        )
    return repr((_structure(bodies, points), _structure(control_bodies), up_axis, tuple(guides), sloped))


def _structure(bodies: Sequence[BodyArrays], points: Sequence[ContactPoint] = ()) -> str:
    """All that the text of a kernel depends on: topology, axes, and which run-time inputs are zero."""
    zeros: list[bool] = []

    def visit(value: float) -> float:
        zeros.append(value == 0.0)
        return value

    _map_values(bodies, points, visit)
    frames = [(body.parent, body.prismatic, body.axis, body.rotation) for body in bodies]
    return repr((frames, [point.body for point in points], zeros))
