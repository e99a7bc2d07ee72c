"""The few commands of meshcat's viewer that are needed, as the plain values that it reads.

Commands are dictionaries that a window takes and keeps for a page, or sends to one. Building them here needs
neither a server nor meshcat's Python package, keeps the case of property names, and names every object after
its place in the scene, so that the same scene gives the same bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np

from twin_gait.viewer.shapes import Shape

_CHALK = 0.7  # surfaces at least as rough show no gloss

Command = dict[str, Any]
State = dict[tuple[str, str], Any]  # values of properties, by place and name
Colour = Sequence[float]  # red, green and blue from 0 to 1


@dataclass(frozen=True, kw_only=True)
class Material:
    """How a surface looks."""

    colour: Colour
    opacity: float = 1.0  # from 0 to 1
    roughness: float = 0.55  # 0 is a mirror, 1 is chalk
    glow: float = 0.0  # share of the colour that needs no light
    two_sided: bool = False  # whether the inside is drawn too; for meshes that may have holes


def rgb(colour: str) -> Colour:
    """Red, green and blue from 0 to 1 of a colour written as ``#RRGGBB``."""
    return [part / 255.0 for part in bytes.fromhex(colour[1:])]


def set_object(path: str, shape: Shape, material: Material) -> Command:
    """Command that draws a mesh. ``path``: place in the scene, for example ``/robot/left_hip/shell``."""
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
    window: Window, path: str, shape: Shape, material: Material, *, casts: bool = False, shaded: bool = False
) -> None:
    """Draw a mesh. ``casts``: whether it casts a shadow; ``shaded``: whether shadows fall on it."""
    window.send(set_object(path, shape, material))
    window.send(set_property(f"{path}/<object>", "receiveShadow", shaded))
    window.send(set_property(f"{path}/<object>", "castShadow", casts))


def set_transform(path: str, placement: np.ndarray) -> Command:
    """Command that places a group.

    ``placement``: homogeneous transform in the parent group, shape ``(4, 4)``.
    """
    return {"type": "set_transform", "path": path, "matrix": [float(value) for value in placement.T.ravel()]}


def set_property(path: str, name: str, value: Any) -> Command:
    """Command that sets a property of an object of three.js, such as ``visible`` or ``castShadow``.

    ``value``: a number, a truth value, a text or a list of numbers.
    """
    return {"type": "set_property", "path": path, "property": name, "value": value}


_KINDS = {"quaternion": "quaternion", "visible": "bool", "material.color": "color"}  # of tracks; else vectors


@dataclass(frozen=True)
class Track:
    """One property over time."""

    path: str  # the object
    name: str  # property: ``position``, ``quaternion``, ``scale``, ``visible`` or ``material.color``
    times: np.ndarray  # of the keys in [s], shape ``(n,)``
    values: np.ndarray  # one row per key


def set_animation(tracks: Sequence[Track], frames_per_second: float) -> Command:
    """Command that hands an animation over, ready and standing still at its start."""
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
    """A command after its length in four bytes, lowest first; several stand one after the other.

    Numbers are single precision, which the viewer draws with anyway.
    """
    block = bytes(msgpack.packb(command, use_single_float=True))
    return struct.pack("<I", len(block)) + block


def _buffers(shape: Shape) -> Command:
    # Rounded coordinates compress to about half. Points of a seam, which differ in the last bit, are made
    # equal first: rounded apart, they would leave a crack.
    attributes = {
        "position": _array(np.round(np.round(shape.vertices, 8), 5) + 0.0),
        "normal": _array(np.round(shape.normals, 3) + 0.0),
    }
    if shape.colours is not None:
        attributes["color"] = _array(shape.colours)
    return {"attributes": attributes, "index": _array(shape.faces.reshape(-1, 1))}


def _array(rows: np.ndarray) -> Command:
    """A typed array, by the name of three.js and the code of msgpack-lite, which meshcat's viewer reads."""
    whole = rows.dtype.kind == "i"
    name, code, kind = ("Uint32Array", 0x16, "<u4") if whole else ("Float32Array", 0x17, "<f4")
    packed = msgpack.ExtType(code, rows.astype(kind).tobytes())
    return {"itemSize": rows.shape[1], "type": name, "array": packed, "normalized": False}


def _surface(material: Material, shape: Shape) -> Command:
    # Without a graphics card the gloss of a pixel costs more than everything else: chalk does without.
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
        # Only front faces, and no depth: what lies behind a translucent part must stay visible.
        surface |= {"opacity": material.opacity, "transparent": True, "depthWrite": False, "side": 0}
    return surface


def _integer(colour: Colour) -> int:
    return int.from_bytes(round(255.0 * value) for value in colour)


# Objects first, because setting one clears its properties; the animation after them, because its tracks
# look for the objects. What a live page says stands around them: what it is, and its last numbers.
_ORDER = ("page", "set_object", "set_transform", "set_property", "set_animation", "sample")


class Window:
    """What takes commands: it keeps the whole scene, and what has changed in it since somebody asked."""

    def __init__(self) -> None:
        """Start empty."""
        self._commands: dict[Hashable, Command] = {}  # the last one of each kind for each place
        self._changes: dict[Hashable, Command] = {}
        self._samples = 0

    def send(self, command: Command) -> None:
        """Take a command, unless it would change nothing."""
        key = command["type"], command["path"], command.get("property", "")
        if self._commands.get(key) != command:
            self._commands[key] = self._changes[key] = command

    def apply(self, state: State) -> None:
        """Set properties."""
        for (path, name), value in state.items():
            self.send(set_property(path, name, value))

    def sample(self, sample: Command) -> None:
        """Take the numbers of a moment; none gives way to a later one, because curves are drawn of them."""
        self._samples += 1
        command = {"type": "sample", "path": "", "sample": sample}
        self._commands["sample"] = self._changes["sample", self._samples] = command

    def commands(self) -> list[Command]:
        """The whole scene, in the order in which a viewer must take it."""
        return sorted(self._commands.values(), key=lambda command: _ORDER.index(command["type"]))

    def packed(self) -> bytes:
        """All commands, one after the other as :func:`pack` has them."""
        return b"".join(map(pack, self.commands()))

    def changes(self) -> list[tuple[Hashable, bytes]]:
        """What has changed since the last call: a key each, and the packed command."""
        packed = [(key, pack(command)) for key, command in self._changes.items()]
        self._changes.clear()
        return packed
