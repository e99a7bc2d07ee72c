"""The kernel of a model with many joints: calls of the loops in :mod:`twin_gait.core.articulated_body`.

The text is the same for every such model, so that they share one compiled kernel; the model itself, topology
and axes included, is data.
"""

from __future__ import annotations

from collections.abc import Sequence

from twin_gait.leg_model.bodies import BodyArrays, ContactPoint

IMPORT = "from twin_gait.core import articulated_body\n"
_UP = {"y": 1, "z": 2}
# Name of a kernel's function, its arguments, and the loops behind it with theirs.
_CALLS = {
    "dynamics": (
        "q, v, torque, bodies, gravity, contact, a, points",
        "forward_dynamics(q, v, torque, bodies, {up}, gravity, contact, a, points)",
    ),
    "contact_forces": ("q, v, bodies, contact, points", "contact_forces(q, v, bodies, contact, points)"),
    "observe": (
        "q, v, a, bodies, gravity, points",
        "observe(q, v, a, bodies, {up}, gravity, points)",
    ),
    "control_gravity": (
        "q, bodies, gravity, torque",
        "gravity_torques(q, bodies, {up}, gravity, torque)",
    ),
    "control_inertia": ("q, a, bodies, torque", "inertia_torques(q, a, bodies, torque)"),
}


def tree_values(bodies: Sequence[BodyArrays], points: Sequence[ContactPoint]) -> list[float]:
    """A model as the flat array that :mod:`twin_gait.core.articulated_body` reads."""
    values: list[float] = []
    for body in bodies:
        values += [float(body.parent + 1), float(body.prismatic), *body.axis]
        values += [entry for row in body.rotation for entry in row]
        values += [*body.position, body.mass, *body.first_moment]
        values += [entry for row in body.inertia for entry in row]
        values.append(body.armature)
    for point in points:
        values += [float(point.body + 1), *point.position]
    return values


def write_call(name: str, up_axis: str = "z") -> str:
    """Source of one function of a kernel, with the import that it needs.

    Args:
        name: Of the function, from :mod:`twin_gait.simulation.kernel_interface`.
        up_axis: ``"z"`` or ``"y"``.
    """
    arguments, call = _CALLS[name]
    body = f"return articulated_body.{call.format(up=_UP[up_axis])}"
    return f"{IMPORT}\n\ndef {name}({arguments}):\n    {body}\n"
