"""Commands of meshcat's viewer that are needed, as the plain values that it reads.

Commands are dictionaries, which a window collects for a page or sends to one. Building them here needs
neither a server nor meshcat's Python package, keeps the case of property names, and names every object by its
path in the scene, so that the same scene gives the same bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np

from twin_gait.viewer.shapes import Shape

_CHALK = 0.7  # roughness from which on a surface is drawn without gloss

Command = dict[str, Any]
SceneState = dict[tuple[str, str], Any]  # values of properties, by path and name
Colour = Sequence[float]  # red, green and blue from 0 to 1


@dataclass(frozen=True, kw_only=True)
class Material:
    """Appearance of a surface."""

    colour: Colour
    opacity: float = 1.0  # from 0 to 1
    roughness: float = 0.55  # 0 is a mirror, 1 is chalk
    glow: float = 0.0  # share of the colour that needs no light
    two_sided: bool = False  # whether the inside is also drawn; for meshes that may have holes


def rgb(colour: str) -> Colour:
    """Convert a colour ``#RRGGBB`` to red, green and blue from 0 to 1."""
    return [part / 255.0 for part in bytes.fromhex(colour[1:])]


def set_object(path: str, shape: Shape, material: Material) -> Command:
    """Return the command that draws a mesh; ``path`` in the scene, such as ``/robot/left_hip/shell``."""
    geometry, surface = f"{path}:geometry", f"{path}:material"
    return {
        "type": "set_object",
        "path": path,
        "object": {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [{"uuid": geometry, "type": "BufferGeometry", "data": _buffers(shape)}],
            "materials": [{"uuid": surface, **_surface(material, shape)}],
            "object": {"uuid": f"{path}:mesh", "type": "Mesh", "geometry": geometry, "material": surface},
        },
    }


def draw_mesh(
    window: CommandBuffer,
    path: str,
    shape: Shape,
    material: Material,
    *,
    casts: bool = False,
    shaded: bool = False,
) -> None:
    """Draw a mesh; ``casts``: whether it casts a shadow; ``shaded``: whether it receives shadows."""
    window.send(set_object(path, shape, material))
    window.send(set_property(f"{path}/<object>", "receiveShadow", shaded))
    window.send(set_property(f"{path}/<object>", "castShadow", casts))


def set_transform(path: str, placement: np.ndarray) -> Command:
    """Return the command that places a group.

    ``placement``: homogeneous transform in the parent group, shape ``(4, 4)``.
    """
    return {"type": "set_transform", "path": path, "matrix": [float(value) for value in placement.T.ravel()]}


def set_property(path: str, name: str, value: Any) -> Command:
    """Return the command that sets a property of an object of three.js, such as ``visible``.

    ``value``: a number, a boolean, a text or a list of numbers.
    """
    return {"type": "set_property", "path": path, "property": name, "value": value}


# Types of tracks by property; all others are vectors.
_KINDS = {"quaternion": "quaternion", "visible": "bool", "material.color": "color"}


@dataclass(frozen=True)
class Track:
    """Values of one property over time."""

    path: str  # path of the object in the scene
    name: str  # property: ``position``, ``quaternion``, ``scale``, ``visible`` or ``material.color``
    times: np.ndarray  # times of the keys in [s], shape ``(n,)``
    values: np.ndarray  # one row per key


def set_animation(tracks: Sequence[Track], frames_per_second: float) -> Command:
    """Return the command that loads an animation, paused at its start."""
    clips: dict[str, list[Command]] = {}
    for track in tracks:
        times = (track.times * frames_per_second).tolist()
        pairs = zip(times, track.values.tolist(), strict=True)
        keys = [{"time": time, "value": value} for time, value in pairs]
        kind = _KINDS.get(track.name, "vector3")
        clips.setdefault(track.path, []).append({"name": f".{track.name}", "type": kind, "keys": keys})
    return {
        "type": "set_animation",
        "path": "",
        "animations": [
            {"path": path, "clip": {"fps": frames_per_second, "name": "run", "tracks": items}}
            for path, items in clips.items()
        ],
        "options": {"play": True, "repetitions": 1},
    }


def pack(command: Command) -> bytes:
    """Encode a command: its length in four bytes, little-endian, then the command; several are concatenated.

    Numbers have single precision, which the viewer uses for drawing.
    """
    block = bytes(msgpack.packb(command, use_single_float=True))
    return struct.pack("<I", len(block)) + block


def _buffers(shape: Shape) -> Command:
    # Rounded coordinates compress to about half. Points of a seam, which differ in the last bit, are made
    # equal first, because a gap would be visible if they were rounded differently.
    attributes = {
        "position": _array(np.round(np.round(shape.vertices, 8), 5) + 0.0),
        "normal": _array(np.round(shape.normals, 3) + 0.0),
    }
    if shape.colours is not None:
        attributes["color"] = _array(shape.colours)
    return {"attributes": attributes, "index": _array(shape.faces.reshape(-1, 1))}


def _array(rows: np.ndarray) -> Command:
    """Encode a typed array for meshcat: the type name of three.js and the type code of msgpack-lite."""
    whole = rows.dtype.kind == "i"
    name, code, kind = ("Uint32Array", 0x16, "<u4") if whole else ("Float32Array", 0x17, "<f4")
    packed = msgpack.ExtType(code, rows.astype(kind).tobytes())
    return {"itemSize": rows.shape[1], "type": name, "array": packed, "normalized": False}


def _surface(material: Material, shape: Shape) -> Command:
    # Without a graphics card, gloss is the most expensive part of a pixel; rough surfaces have none.
    chalk = material.roughness >= _CHALK
    surface: Command = {
        "type": "MeshLambertMaterial" if chalk else "MeshStandardMaterial",
        "color": _integer(material.colour),
        "emissive": _integer([material.glow * value for value in material.colour]),
        "side": 2 if material.two_sided else 0,
        "vertexColors": shape.colours is not None,
    }
    if not chalk:
        surface |= {"roughness": material.roughness, "metalness": 0.0}
    if material.opacity < 1.0 or (shape.colours is not None and shape.colours.shape[1] == 4):
        # Only front faces are drawn, and no depth is written, so that parts behind it stay visible.
        surface |= {"opacity": material.opacity, "transparent": True, "depthWrite": False, "side": 0}
    return surface


def _integer(colour: Colour) -> int:
    return int.from_bytes(round(255.0 * value) for value in colour)


# Objects come before properties, because setting an object clears its properties; the animation comes after
# the objects, because its tracks refer to them. A live page has its description first and its sample last.
_ORDER = ("page", "set_object", "set_transform", "set_property", "set_animation", "sample")


class CommandBuffer:
    """Collector of commands: it stores the whole scene, and its changes since the last call of changes()."""

    def __init__(self) -> None:
        """Create an empty window."""
        self._commands: dict[Hashable, Command] = {}  # last command of each kind for each path
        self._changes: dict[Hashable, Command] = {}
        self._samples = 0

    def send(self, command: Command) -> None:
        """Store a command, unless it would change nothing."""
        key = command["type"], command["path"], command.get("property", "")
        if self._commands.get(key) != command:
            self._commands[key] = self._changes[key] = command

    def apply(self, state: SceneState) -> None:
        """Set the properties of a state."""
        for (path, name), value in state.items():
            self.send(set_property(path, name, value))

    def sample(self, sample: Command) -> None:
        """Store the numbers of one time; later samples do not replace it, because curves need all of them."""
        self._samples += 1
        command = {"type": "sample", "path": "", "sample": sample}
        self._commands["sample"] = self._changes["sample", self._samples] = command

    def commands(self) -> list[Command]:
        """Return the whole scene in the order in which a viewer must receive it."""
        return sorted(self._commands.values(), key=lambda command: _ORDER.index(command["type"]))

    def packed(self) -> bytes:
        """Return all commands, encoded by :func:`pack` and concatenated."""
        return b"".join(map(pack, self.commands()))

    def changes(self) -> list[tuple[Hashable, bytes]]:
        """Return the changes since the last call: the key and the encoded command of each."""
        packed = [(key, pack(command)) for key, command in self._changes.items()]
        self._changes.clear()
        return packed
