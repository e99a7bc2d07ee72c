"""Generator of the rigid-body dynamics of one model as straight-line Python.

The generic algorithms of :mod:`twin_gait.kernels.rigid_body` run once over symbols, and the operations are
written as text. Topology, axes and structural zeros are constants of the text. Masses, inertias, lengths and
armatures are inputs, so that another wearer needs no new kernel.

Straight-line code runs five to ten times faster than loops, but its text grows with the square of the number
of joints, and the time to compile grows even faster: models of more than :data:`STRAIGHT_LINE_LIMIT` joints
are rejected.
"""

import inspect
import re
from collections.abc import Callable, Sequence
from dataclasses import fields
from itertools import chain, count
from typing import Any, NamedTuple

from twin_gait.core.contact import ContactState, ground_contact_force, sloped_contact_force
from twin_gait.core.elementary import sine_cosine
from twin_gait.exceptions import ModelError
from twin_gait.kernels import rigid_body
from twin_gait.kernels.rigid_body import Bodies, Points, Vector, vector
from twin_gait.kernels.tracing import (
    Scalar,
    Trace,
    TraceStep,
    inline_single_uses,
    merge_calls,
    rename_results,
    scalar_source,
)
from twin_gait.leg_model.bodies import BodyArrays

# Largest number of joints of a model. The function ``dynamics`` alone compiles in 0.5 s for 2 joints, 14 s
# for 16 and 100 s for 32. Two legs with ankles on a pelvis that pitches have 9 joints, in braces 18.
STRAIGHT_LINE_LIMIT = 18

POINT_FIELDS = tuple(item.name for item in fields(ContactState))


class MergedFunction(NamedTuple):
    """Function that kernels call for several items at once, whose calls may become one vector operation."""

    function: Callable[..., tuple[float, ...]]  # Function of one item.
    shared: int  # Number of leading arguments that all items have in common.
    arguments: int  # Number of arguments of each item.
    results: tuple[str, ...]  # Quantities of the results of each item.

    @property
    def name(self) -> str:
        """Name of the function in the text of a kernel."""
        return self.function.__name__


MERGED_FUNCTIONS = (
    MergedFunction(sine_cosine, 0, 1, ("sine", "cosine")),
    MergedFunction(ground_contact_force, 1, 5, ("forward_force", "upward_force")),
)


def _numbers_of(body: BodyArrays) -> list[float]:
    """Return the numbers of a body that a kernel may read at run time, in the kernel's order."""
    rows = [body.inertia[i][j] for i in range(3) for j in range(i, 3)]
    return [*rows, *body.position, body.mass, *body.first_moment, body.armature]


def _symbolic_body(body: BodyArrays, symbols: Sequence[Any]) -> BodyArrays:
    """Return a body with symbols in place of its numbers, in the order of :func:`_numbers_of`."""
    xx, xy, xz, yy, yz, zz = symbols[:6]
    return body._replace(
        axis=vector(body.axis),
        rotation=vector(body.rotation),
        inertia=vector([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        position=vector(symbols[6:9]),
        mass=symbols[9],
        first_moment=vector(symbols[10:13]),
        armature=symbols[13],
    )


def _values_of(bodies: Bodies, points: Points) -> list[float]:
    """Return all numbers that a kernel may read, in its order; zeros are constants of its text."""
    values = [value for body in bodies for value in _numbers_of(body)]
    return values + [value for point in points for value in point.position]


def body_values(bodies: Bodies, points: Points = ()) -> list[float]:
    """Return the run-time inputs of a kernel in its order, without structural zeros."""
    return [value for value in _values_of(bodies, points) if value != 0.0]


class KernelBodies(NamedTuple):
    """Model for which a kernel is generated."""

    bodies: Bodies
    points: Points  # Points of the plant that may touch the ground.
    control_bodies: Bodies
    up_axis: str  # Vertical axis of the world, ``"z"`` or ``"y"``.
    guides: Sequence[int] = (0,)
    sloped: bool = False  # Whether the ground may rise forwards; level ground needs no rotation.


class _Function:
    """Function of a kernel during its generation: its inputs as symbols, and the operations so far."""

    def __init__(self, bodies: Bodies, points: Points = (), up_axis: str = "z") -> None:
        self.trace, indices = Trace(), count()

        def symbol(value: float) -> Scalar:
            return self.trace.input(f"bodies[{next(indices)}]") if value != 0.0 else 0.0

        self.bodies = [_symbolic_body(body, [*map(symbol, _numbers_of(body))]) for body in bodies]
        self.points = [point._replace(position=vector([*map(symbol, point.position)])) for point in points]
        self.zeros: list[Scalar] = [0.0] * len(bodies)
        self._up_axis = up_axis

    def inputs(self, name: str) -> Vector:
        """Return the symbols of an array with an entry for each coordinate."""
        return vector([self.trace.input(f"{name}[{index}]") for index in range(len(self.bodies))])

    def note(self, comment: str, quantity: str, body: BodyArrays | None) -> None:
        """Start a step of an algorithm, with a comment: for a body, or None for the world."""
        name = body.name if body else ""
        self.trace.block = TraceStep(f"{comment}: {name}." if name else f"{comment}.", quantity, name)

    @property
    def gravity(self) -> Vector:
        """Acceleration of gravity in the world frame, shape ``(3,)``."""
        down = -self.trace.input("gravity")
        return vector([0.0, 0.0, down] if self._up_axis == "z" else [0.0, down, 0.0])

    def contact_law(self, sloped: bool) -> rigid_body.ContactLaw:
        """Return a law that calls the contact law in core; it returns forces, height and power of a point."""
        sine: Any = self.trace.input("ground.slope_sine")
        cosine: Any = self.trace.input("ground.slope_cosine")

        def law(number: int, position: Vector, velocity: Vector) -> list[Scalar]:
            part = "forefoot_" if self.points[number].forefoot else ""
            common = ["ground", f"ground.{part}stiffness", f"ground.{part}dissipation"]

            def press(*state: Any) -> Any:
                given = [*map(self.trace.input, common), *state]
                return self.trace.call("ground_contact_force", given, MERGED_FUNCTIONS[1].results)

            point, speed = (position[0], position[2]), (velocity[0], velocity[2])
            height = point[1]
            if sloped:
                forward, upward, height = sloped_contact_force(sine, cosine, point, speed, press)
            else:
                forward, upward = press(height, *speed)
            return [forward, upward, height, forward * velocity[0] + upward * velocity[2]]

        return law

    def source(
        self,
        signature: str,
        docstring: str,
        stores: Sequence[tuple[str, Scalar]],
        returned: Sequence[Scalar] = (),
    ) -> str:
        """Return the source of the function, with its stores and its return statement."""
        outputs = [value for _, value in stores] + list(returned)
        body = self.trace.live_lines(outputs)
        for item in MERGED_FUNCTIONS:
            body = merge_calls(body, item.name, item.shared)
        lines = inline_single_uses(body, {scalar_source(value) for value in outputs})
        lines += [f"{target} = {scalar_source(value)}" for target, value in stores]
        if returned:
            lines.append(f"return {', '.join(scalar_source(value) for value in returned)}")
        lines = rename_results(lines, self.trace)
        return "\n    ".join([f"def {signature}:", f'"""{docstring}"""', *lines]) + "\n"


def _stores(name: str, values: Sequence[Scalar]) -> list[tuple[str, Scalar]]:
    return [(f"{name}[{index}]", value) for index, value in enumerate(values)]


def _point_stores(contacts: Sequence[Sequence[Scalar]]) -> list[tuple[str, Scalar]]:
    return [
        (f"points[{number}].{name}", value)
        for number, results in enumerate(contacts)
        for name, value in zip(POINT_FIELDS, results[:-1], strict=True)
    ]


def _power(contacts: Sequence[Sequence[Scalar]]) -> Scalar:
    return sum(results[-1] for results in contacts)


def write_dynamics(kernel: KernelBodies) -> str:
    """Return the source of ``dynamics``; see :mod:`twin_gait.simulation.backend`."""
    made = _Function(kernel.bodies, kernel.points, kernel.up_axis)
    q, v, torque, rotors = (made.inputs(name) for name in ("q", "v", "torque", "rotors"))
    bodies = [
        body if body.armature == 0.0 else body._replace(armature=rotor)
        for body, rotor in zip(made.bodies, rotors, strict=True)
    ]
    acceleration, contacts = rigid_body.forward_dynamics(
        bodies, q, v, torque, made.gravity, made.points, made.contact_law(kernel.sloped), made.note
    )
    stores = _stores("a", acceleration) + _point_stores(contacts)
    signature = "dynamics(q, v, torque, rotors, bodies, gravity, ground, a, points)"
    return made.source(signature, "Compute the accelerations of the model.", stores, [_power(contacts)])


def write_contact_forces(kernel: KernelBodies) -> str:
    """Return the source of ``contact_forces``."""
    made = _Function(kernel.bodies, kernel.points)
    q, v, law = made.inputs("q"), made.inputs("v"), made.contact_law(kernel.sloped)
    contacts = rigid_body.inverse_dynamics(
        made.bodies, q, v, made.zeros, rigid_body.ZERO, made.points, law, made.note
    ).contacts
    signature = "contact_forces(q, v, bodies, ground, points)"
    return made.source(signature, "Compute the contact forces.", _point_stores(contacts), [_power(contacts)])


def write_observe(kernel: KernelBodies) -> str:
    """Return the source of ``observe``; its wrench is the sum over all guides, each about its own origin."""
    made = _Function(kernel.bodies, kernel.points, kernel.up_axis)
    q, v, a = (made.inputs(name) for name in ("q", "v", "a"))

    def known_force(number: int, position: Vector, velocity: Vector) -> list[Scalar]:
        return [made.trace.input(f"points[{number}].{name}") for name in POINT_FIELDS[:2]]

    result = rigid_body.inverse_dynamics(
        made.bodies, q, v, a, made.gravity, made.points, known_force, made.note
    )
    potential = rigid_body.potential_energy(made.bodies, q, made.gravity, made.note)
    wrenches = [result.wrenches[guide] for guide in kernel.guides]
    pitching, forward = sum(moment[1] for moment, _ in wrenches), sum(force[0] for _, force in wrenches)
    returned = [result.kinetic_energy, potential, forward, pitching]
    signature = "observe(q, v, a, bodies, gravity, points)"
    return made.source(signature, "Compute the energies and the wrench of the guides.", [], returned)


def write_control_gravity(bodies: Bodies, up_axis: str) -> str:
    """Return the source of ``control_gravity``."""
    made = _Function(bodies, (), up_axis)
    result = rigid_body.inverse_dynamics(
        made.bodies, made.inputs("q"), made.zeros, made.zeros, made.gravity, note=made.note
    )
    signature = "control_gravity(q, bodies, gravity, torque)"
    return made.source(signature, "Compute the gravity torques.", _stores("torque", result.torques))


def write_control_inertia(bodies: Bodies) -> str:
    """Return the source of ``control_inertia``."""
    made, indices = _Function(bodies), range(len(bodies))
    lower, a = rigid_body.mass_matrix(made.bodies, made.inputs("q"), made.note), made.inputs("a")
    torques: list[Scalar] = []
    for i in indices:
        made.note("Torque", "torque", bodies[i])
        torques.append(vector([lower[max(i, j)][min(i, j)] for j in indices]) @ a)
    signature = "control_inertia(q, a, bodies, torque)"
    return made.source(signature, "Compute the inertia torques.", _stores("torque", torques))


def write_kernel(kernel: KernelBodies) -> str:
    """Return the source of all functions of :mod:`twin_gait.simulation.backend` for one structure.

    The module of the source must contain the functions of :data:`MERGED_FUNCTIONS`.
    """
    functions = [
        write_dynamics(kernel),
        write_contact_forces(kernel),
        write_observe(kernel),
        write_control_gravity(kernel.control_bodies, kernel.up_axis),
        write_control_inertia(kernel.control_bodies),
    ]
    return "\n\n".join([*write_merged_functions("".join(functions)), *functions])


def write_merged_functions(text: str) -> list[str]:
    """Return the sources of the functions that a kernel calls for several items at once, as single calls.

    ``text``: text of the kernel, from which the numbers of items are read.
    """
    found = []
    for item in MERGED_FUNCTIONS:
        for calls in sorted({int(number) for number in re.findall(rf"\b{item.name}_(\d+)\(", text)}):
            given = list(inspect.signature(item.function).parameters)
            common, each = given[: item.shared], given[item.shared :]
            arguments = [[f"{name}_{number + 1}" for name in each] for number in range(calls)]
            results = [[f"{name}_{number + 1}" for name in item.results] for number in range(calls)]
            lines = [f"def {item.name}_{calls}({', '.join([*common, *chain(*arguments)])}):"]
            lines.append(f'    """Call {item.name} {calls} times."""')
            for left, right in zip(results, arguments, strict=True):
                lines.append(f"    {', '.join(left)} = {item.name}({', '.join(common + right)})")
            lines.append(f"    return {', '.join(chain(*results))}")
            found.append("\n".join(lines) + "\n")
    return found


def kernel_key(kernel: KernelBodies) -> str:
    """Return a key of the data that determine the text of :func:`write_kernel`, in a hundredth of its time.

    Raises ModelError if the plant has more than :data:`STRAIGHT_LINE_LIMIT` joints.
    """
    bodies, points, control_bodies, up_axis, guides, sloped = kernel
    if len(bodies) > STRAIGHT_LINE_LIMIT:
        raise ModelError(
            f"the model has {len(bodies)} joints, those in braces counted twice, but the compiled engine "
            f"supports at most {STRAIGHT_LINE_LIMIT}; set engine: pinocchio"
        )
    return repr(
        (_topology_key(bodies, points), _topology_key(control_bodies), up_axis, tuple(guides), sloped)
    )


def _topology_key(bodies: Bodies, points: Points = ()) -> str:
    """Return the data that determine a kernel: names, topology, axes, and which run-time inputs are zero."""
    frames = [(body.name, body.parent, body.prismatic, body.axis, body.rotation) for body in bodies]
    zeros = [value == 0.0 for value in _values_of(bodies, points)]
    return repr((frames, [(point.body, point.forefoot) for point in points], zeros))
