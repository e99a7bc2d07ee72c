"""What stands around the figure: light, floor, treadmill, bench."""

from __future__ import annotations

import numpy as np

from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material, Window, set_object, set_property, set_transform
from twin_gait.viewer.shapes import Shape

Triple = tuple[float, float, float]

ROOT = "/meshcat/surroundings"
BELT = f"{ROOT}/belt"
BELT_MARK_SPACING = 0.12  # [m]

_FLOOR = Material(colour=(0.90, 0.92, 0.94), roughness=0.95)
_DECK = Material(colour=(0.83, 0.86, 0.89), roughness=0.5)
_RUBBER = Material(colour=(0.20, 0.22, 0.25), roughness=0.95)
_MARK = Material(colour=(0.55, 0.60, 0.66), roughness=0.95)
_STEEL = Material(colour=(0.70, 0.74, 0.79), roughness=0.4, metalness=0.15)

_BELT_LENGTH, _BELT_WIDTH = 1.70, 0.70
_RAIL_WIDTH = 0.055
_DECK_HEIGHT = 0.085
_END_LENGTH = BELT_MARK_SPACING + 0.02  # hides the marks where they jump back by one spacing


def set_studio(window: Window) -> None:
    """Set a pale background and the light of a studio, with soft shadows.

    Args:
        window: Where commands go.
    """
    properties = [
        ("/Background", "top_color", [0.985, 0.99, 0.995]),
        ("/Background", "bottom_color", [0.86, 0.885, 0.91]),
        ("/Axes", "visible", False),
        ("/Grid", "visible", False),
        ("/Lights/PointLightNegativeX", "visible", False),
        ("/Lights/PointLightPositiveX", "visible", False),
        ("/Lights/AmbientLight/<object>", "intensity", 0.52),
        ("/Lights/FillLight/<object>", "position", [-2.5, -4.0, 4.0]),
        ("/Lights/FillLight/<object>", "intensity", 0.30),
        ("/Lights/SpotLight", "visible", True),
        ("/Lights/SpotLight/<object>", "position", [1.2, -2.8, 5.0]),
        ("/Lights/SpotLight/<object>", "castShadow", True),
        ("/Lights/SpotLight/<object>", "intensity", 0.36),
        ("/Lights/SpotLight/<object>", "angle", 0.5),
        ("/Lights/SpotLight/<object>", "penumbra", 0.9),
    ]
    for path, name, value in properties:
        window.send(set_property(path, name, value))


def draw_floor(window: Window, height: float, radius: float = 2.2) -> None:
    """Draw a round floor that fades into the background.

    Args:
        window: Where commands go.
        height: In [m].
        radius: At which it has faded out, in [m].
    """
    rings = np.linspace(1.0, 0.0, 13)
    disc = shapes.turned([(float(ring) * radius, 0.0) for ring in rings], columns=64)
    share = np.linalg.norm(disc.vertices, axis=1) / radius
    opacity = np.clip((1.0 - share) / 0.6, 0.0, 1.0)
    faded = disc._replace(opacity=opacity * opacity * (3.0 - 2.0 * opacity))
    _place(window, "floor", faded, _FLOOR, (0.0, 0.0, height))
    # Drawn before other translucent parts, which must not vanish behind it.
    window.send(set_property(f"{ROOT}/floor/<object>", "renderOrder", -1))
    window.send(set_property(f"{ROOT}/floor/<object>", "castShadow", False))


def draw_treadmill(window: Window) -> None:
    """Draw a treadmill whose belt lies at height 0 and runs along x.

    Args:
        window: Where commands go.
    """
    belt = 0.03
    under = -0.5 * (_DECK_HEIGHT + belt)
    _box(window, "deck", (_BELT_LENGTH, _BELT_WIDTH, _DECK_HEIGHT - belt), _STEEL, (0.0, 0.0, under))
    _box(window, "belt_surface", (_BELT_LENGTH, _BELT_WIDTH, belt), _RUBBER, (0.0, 0.0, -0.5 * belt - 0.0005))
    for side, y in (("left", 1.0), ("right", -1.0)):
        place = (0.0, y * 0.5 * (_BELT_WIDTH + _RAIL_WIDTH), -0.5 * _DECK_HEIGHT + 0.008)
        _box(window, f"rail_{side}", (_BELT_LENGTH + 0.02, _RAIL_WIDTH, _DECK_HEIGHT), _DECK, place)
    for end, x in (("front", 1.0), ("back", -1.0)):
        place = (x * 0.5 * (_BELT_LENGTH - _END_LENGTH + 0.03), 0.0, -0.5 * _DECK_HEIGHT + 0.010)
        size = (_END_LENGTH + 0.03, _BELT_WIDTH + 2.0 * _RAIL_WIDTH + 0.01, _DECK_HEIGHT)
        _box(window, f"end_{end}", size, _DECK, place)
    inner = _BELT_LENGTH - _END_LENGTH
    for number, x in enumerate(np.arange(-0.5 * inner + 0.02, 0.5 * inner + 0.01, BELT_MARK_SPACING)):
        mark = shapes.rounded_box((0.014, _BELT_WIDTH - 0.04, 0.002), 0.0005)
        path = f"{BELT}/mark_{number}"
        window.send(set_object(path, mark, _MARK))
        window.send(set_property(f"{path}/<object>", "castShadow", False))
        window.send(set_transform(path, _translation((float(x), 0.0, -0.0008))))
    draw_floor(window, -_DECK_HEIGHT)


def draw_bench(window: Window, floor: float, hip: np.ndarray, far_side: float) -> None:
    """Draw the stand that holds a leg: base, column on the far side, and an arm to the hip.

    Args:
        window: Where commands go.
        floor: Height of the floor in [m].
        hip: Position of the hip in [m], shape ``(3,)``.
        far_side: 1 if the column stands to the left of the leg, -1 if to its right.
    """
    x, y, z = (float(value) for value in hip)
    behind, beside = x - 0.09, y + far_side * 0.24
    top = z + 0.10
    _box(window, "base", (0.62, 0.50, 0.035), _RUBBER, (behind + 0.10, y + far_side * 0.12, floor + 0.0175))
    _box(window, "column", (0.085, 0.085, top - floor), _DECK, (behind, beside, 0.5 * (top + floor)))
    _box(window, "arm", (0.06, 0.24, 0.06), _STEEL, (behind, y + far_side * 0.12, z + 0.03))
    draw_floor(window, floor)


def belt_offset(time: float, belt_speed: float) -> float:
    """How far the belt marks are behind where they were drawn.

    Args:
        time: In [s].
        belt_speed: In [m] / [s], backwards positive.

    Returns:
        Offset along x in [m], between minus one spacing and 0.
    """
    return -((belt_speed * time) % BELT_MARK_SPACING)


def _box(window: Window, name: str, size: Triple, material: Material, centre: Triple) -> None:
    _place(window, name, shapes.rounded_box(size, 0.014), material, centre)


def _place(window: Window, name: str, shape: Shape, material: Material, centre: Triple) -> None:
    path = f"{ROOT}/{name}"
    window.send(set_object(path, shape, material))
    window.send(set_transform(path, _translation(centre)))


def _translation(centre: Triple) -> np.ndarray:
    placement = np.eye(4)
    placement[:3, 3] = centre
    return placement
