"""Surroundings of the figure: light, floor, treadmill and mast, bench, chair, walkway and rails.

Their sizes and materials are in ``environment.yaml``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from twin_gait.parameters.environment import ChairParameters
from twin_gait.viewer import shapes
from twin_gait.viewer.commands import (
    CommandBuffer,
    Material,
    SceneState,
    draw_mesh,
    set_property,
    set_transform,
)
from twin_gait.viewer.shapes import Shape
from twin_gait.yaml12 import load_data

if TYPE_CHECKING:
    from twin_gait.viewer.motion import Element, Motion

T = TypeVar("T", float, np.ndarray)
ROOT = "/meshcat/surroundings"
TREADMILL = f"{ROOT}/treadmill"
BELT = f"{TREADMILL}/belt"
FLOOR = f"{ROOT}/floor"
CHAIR = f"{ROOT}/chair"
METRES = f"{ROOT}/metres"
SEAT = "seat_forward_m"  # log column with the position of the front edge of a chair
BELT_MARK_SPACING = 0.20  # [m]
_DRAWN = load_data(Path(__file__).with_suffix(".yaml"))
MATERIALS = {name: Material(**look) for name, look in _DRAWN["materials"].items()}
_EDGE = 0.006  # [m]
_BELT = _DRAWN["places"]["treadmill"]["belt_surface"]["boxes"][0]
_STRIP = _DRAWN["places"]["floor"]["walkway"]["boxes"][0]

_FIRST_MARK, _LAST_MARK = -0.705, 0.80  # [m]; hidden by the covers of the ends at any belt position
_DECK_HEIGHT = 0.085  # [m]
_FLOOR_HEIGHT = -0.02  # [m], height of the floor of a walkway
_BEHIND, _MARKED = 8, 60  # [m], lengths with marks behind and before the start of a walkway
_MAST_HEIGHT = 1.83  # [m], height of the bar in the mesh of the mast


def set_studio(window: CommandBuffer) -> None:
    """Set the background and the light."""
    for path, name, value in _DRAWN["studio"]:
        window.send(set_property(path, name, value))


def draw_environment(
    window: CommandBuffer, name: str, *, placement: np.ndarray | None = None, floor: float = 0.0
) -> None:
    """Draw the parts of a place of ``environment.yaml``.

    ``placement`` of the place in the scene, shape ``(4, 4)``; ``floor``: height of the floor in the frame of
    the place in [m].
    """
    for part, drawn in _DRAWN["places"][name].items():
        solids = [_box(sides, drawn.get("edge", _EDGE), floor) for sides in drawn.get("boxes", ())]
        if "turned" in drawn:
            solids.append(
                shapes.transform_mesh(shapes.revolve(drawn["turned"]), shapes.translation(drawn["at"]))
            )
        whole, shaded = shapes.merge_meshes(solids), drawn.get("shaded", False)
        if placement is not None:
            whole = shapes.transform_mesh(whole, placement)
        path, material = f"{ROOT}/{name}/{part}", MATERIALS[drawn["material"]]
        draw_mesh(window, path, whole, material, casts=not shaded, shaded=shaded)


def _box(sides: Sequence[float | None], edge: float, floor: float = 0.0) -> Shape:
    """Make a box from its two limits along x, y and z in [m]; None is the height of the floor."""
    ends = np.array([floor if side is None else side for side in sides]).reshape(3, 2)
    solid = shapes.rounded_box((ends[:, 1] - ends[:, 0]).tolist(), edge)
    return shapes.transform_mesh(solid, shapes.translation(ends.mean(axis=1)))


def draw_floor(window: CommandBuffer, height: float, radius: float = 2.0) -> None:
    """Draw a round floor that fades into the background.

    ``height`` in [m]; ``radius`` at which the floor is fully transparent, in [m].
    """
    disc = shapes.revolve([(ring * radius, 0.0) for ring in np.linspace(1.0, 0.0, 9)], columns=48)
    share = np.linalg.norm(disc.vertices, axis=1) / radius
    opacity = np.clip((1.0 - share) / 0.6, 0.0, 1.0)
    smooth = opacity * opacity * (3.0 - 2.0 * opacity)
    faded = disc._replace(colours=np.insert(smooth[:, None], [0, 0, 0], 1.0, axis=1))
    draw_mesh(window, FLOOR, faded, MATERIALS["floor"], shaded=True)
    window.send(set_property(FLOOR, "position", [0.0, 0.0, height]))
    # The floor is drawn before other translucent parts, which would otherwise vanish behind it.
    window.send(set_property(f"{FLOOR}/<object>", "renderOrder", -1))


def belt_pose(slope: float) -> np.ndarray:
    """Return the pose of a belt that rises forwards by an angle in [rad], shape ``(4, 4)``."""
    return shapes.frame(np.array([-np.sin(slope), 0.0, np.cos(slope)]), np.array([1.0, 0.0, 0.0]))


def draw_treadmill(window: CommandBuffer, slope: float = 0.0) -> None:
    """Draw a treadmill whose belt runs along x, lower than the soles that press into the soft ground.

    ``slope`` of the belt in [rad], positive if it rises forwards.
    """
    window.send(set_transform(TREADMILL, belt_pose(slope)))
    draw_environment(window, "treadmill")
    marks, width = np.arange(_FIRST_MARK, _LAST_MARK, BELT_MARK_SPACING), _BELT[3] - _BELT[2] - 0.04
    lines = [_line(x, 0.012, width) for x in marks]
    draw_mesh(window, f"{BELT}/marks", shapes.merge_meshes(lines), MATERIALS["mark"], shaded=True)
    draw_floor(window, -_DECK_HEIGHT - 0.9 * abs(np.sin(slope)))


def draw_mast(window: CommandBuffer, hooks: np.ndarray) -> None:
    """Draw a mast next to the treadmill, its arm, and the bar above the wearer to which the ropes are tied.

    ``hooks``: upper ends of the ropes in [m], shape ``(n, 3)``, all at one height.
    """
    height = float(hooks[0, 2]) / _MAST_HEIGHT
    mast = shapes.load_packaged_mesh("mast", np.diag([1.0, 1.0, height, 1.0]))
    draw_mesh(window, f"{ROOT}/mast", mast, MATERIALS["steel"], casts=True)


def draw_bench(window: CommandBuffer, floor: float, hip: np.ndarray, far_side: float) -> None:
    """Draw the bench: a table with vice and weights.

    ``floor``: height of the floor in [m]; ``hip``: position of the hip in [m], shape ``(3,)``; ``far_side``:
    1 if the table is to the left of the leg, -1 if it is to its right.
    """
    placement = np.diag([1.0, far_side, 1.0, 1.0])
    placement[:3, 3] = hip
    draw_environment(window, "bench", placement=placement, floor=floor - float(hip[2]))
    draw_floor(window, floor)


def draw_chair(window: CommandBuffer, chair: ChairParameters) -> Element:
    """Draw a chair, and return the function that moves it to the position in the log."""
    draw_environment(window, "chair")
    window.send(set_property(CHAIR, "scale", [chair.depth, 1.0, chair.height]))

    def state(motion: Motion, frame: int) -> SceneState:
        return {(CHAIR, "position"): [float(motion.columns[SEAT][frame]), 0.0, 0.0]}

    return state


def draw_walkway(window: CommandBuffer, forward: int) -> Element:
    """Draw a walkway along x, and return the function that moves the scene towards the camera.

    The parts that look the same everywhere along the walkway move with the walker. ``forward``: index of the
    walker's forward coordinate.
    """
    draw_floor(window, _FLOOR_HEIGHT, radius=3.2)
    draw_environment(window, "floor")
    # There is a line at each metre; every fifth one is twice as thick.
    metres = range(-_BEHIND, _MARKED + 1)
    lines = [_line(metre, 0.012 if metre % 5 else 0.024, _STRIP[3] - _STRIP[2]) for metre in metres]
    draw_mesh(window, METRES, shapes.merge_meshes(lines), MATERIALS["mark"], shaded=True)

    def state(motion: Motion, frame: int) -> SceneState:
        # The camera moves with the walker: the scene moves backwards, and the floor stays.
        way = float(motion.q[frame][forward])
        return {("/meshcat", "position"): [-way, 0.0, 0.0], (FLOOR, "position"): [way, 0.0, _FLOOR_HEIGHT]}

    return state


def draw_rails(window: CommandBuffer, hooks: np.ndarray) -> None:
    """Draw a rail above the walkway for each rope. ``hooks``: upper ends of the ropes in [m], ``(n, 3)``."""
    rails = [_box([-5.0, _MARKED + 5.0, y - 0.025, y + 0.025, z, z + 0.05], 0.01) for _, y, z in hooks]
    draw_mesh(window, f"{ROOT}/rails", shapes.merge_meshes(rails), MATERIALS["steel"])


def belt_offset(distance: T) -> T:
    """Compute the displacement of the belt marks along x after the belt has moved by ``distance`` in [m].

    The result in [m] is between minus one spacing and 0.
    """
    return -(distance % BELT_MARK_SPACING)


def _line(x: float, length: float, width: float) -> Shape:
    """Make a line across the ground and just above it: its middle, length along x, width along y in [m]."""
    corners = np.array([[-length, -width], [length, -width], [length, width], [-length, width]])
    middle = np.array([x, 0.0, _BELT[5] + 0.0016])
    return Shape(
        middle + 0.5 * np.insert(corners, 2, 0.0, axis=1),
        np.tile([0.0, 0.0, 1.0], (4, 1)),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
