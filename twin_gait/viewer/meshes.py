"""Read what Pinocchio's reader of meshes leaves out: normals of OBJ files, and colours."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin_gait.viewer.shapes import Shape


def read_obj(path: str | Path) -> Shape | None:
    """Read a Wavefront OBJ file whose corners have normals.

    Returns the mesh, or None for a file without normals or of another kind, which other readers know.
    """
    try:
        lines = [line.split() for line in Path(path).read_text(encoding="utf-8").splitlines()]
        vertices = _numbers(lines, "v")
        normals = _numbers(lines, "vn")
        corners = np.array([corner for line in lines if line[:1] == ["f"] for corner in _fan(line[1:])])
        return _indexed(vertices, normals, corners)
    except (OSError, ValueError, IndexError):
        return None


def _numbers(lines: list[list[str]], kind: str) -> np.ndarray:
    return np.array([[float(word) for word in line[1:4]] for line in lines if line[:1] == [kind]])


def _fan(words: list[str]) -> list[list[tuple[int, int]]]:
    """Triangles of a face, each corner as indices of vertex and normal that count from 1."""
    corners = []
    for word in words:
        vertex, _, normal = word.split("/")  # three parts, or it has no normal
        corners.append((int(vertex), int(normal)))
    return [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]


def _indexed(vertices: np.ndarray, normals: np.ndarray, corners: np.ndarray) -> Shape:
    """One vertex for every pair of place and normal."""
    if corners.size == 0 or corners.min() < 1:
        raise ValueError("no faces, or relative indices")
    pairs, index = np.unique(corners.reshape(-1, 2) - 1, axis=0, return_inverse=True)
    turned = normals[pairs[:, 1]]
    turned = turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-30)
    return Shape(vertices[pairs[:, 0]], turned, index.reshape(-1, 3))


Colour = tuple[float, float, float, float]


class Patch(NamedTuple):
    """Neighbouring triangles of one colour in a mesh file."""

    # red, green, blue and opacity from 0 to 1; None where the file has a texture or nothing
    colour: Colour | None
    triangles: int  # how many


def mesh_patches(path: str | Path) -> list[Patch]:
    """Colours that a mesh file has of its own, in the order in which its triangles are listed.

    Who uses the colours compares the number of triangles: readers leave some out. Returns the patches; none
    for a file of another kind or one that is not understood.
    """
    read = {".dae": dae_patches, ".obj": obj_patches}.get(Path(path).suffix.lower())
    try:
        return [] if read is None else read(Path(path))
    except (OSError, ElementTree.ParseError, ValueError, IndexError, AttributeError, TypeError, KeyError):
        return []


def obj_patches(path: Path) -> list[Patch]:
    """Colours of a Wavefront OBJ file, from the libraries of materials that it names.

    Raises ValueError if there is more than one colour and a corner without a normal: :func:`read_obj` leaves
    such a file to Pinocchio's reader, which sorts the triangles by material.
    """
    colours: dict[str, Colour] = {}
    patches, colour, sorted_anew = [], None, False
    for line in path.read_text(encoding="utf-8").splitlines():
        match line.split():
            case ["mtllib", *names]:
                for name in names:
                    colours |= _materials(path.with_name(name))
            case ["usemtl", name, *_]:
                colour = colours.get(name)
            case ["f", *corners]:
                patches.append(Patch(colour, len(corners) - 2))
                sorted_anew |= any(len(word.split("/")) < 3 for word in corners)
    if sorted_anew and len({patch.colour for patch in patches}) > 1:
        raise ValueError("the order of the triangles is not known")
    return patches


def _materials(path: Path) -> dict[str, Colour]:
    """Diffuse colours of a library of materials, by name."""
    found: dict[str, Colour] = {}
    name = ""
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
        match line.split():
            case ["newmtl", name, *_]:
                pass
            case ["Kd", red, green, blue]:
                found[name] = (float(red), float(green), float(blue), 1.0)
    return found


def dae_patches(path: Path) -> list[Patch]:
    """Colours of a COLLADA file.

    Pinocchio's reader goes through the nodes of the scene from the outside in and leaves out triangles of
    which two corners coincide.
    """
    return list(_Collada(path).patches())


class _Collada:
    """The few elements of a COLLADA 1.4 file that say which triangle has which colour."""

    def __init__(self, path: Path) -> None:
        self._root = ElementTree.parse(path).getroot()
        for element in self._root.iter():
            element.tag = element.tag.rpartition("}")[2]
        self._named = {element.get("id"): element for element in self._root.iter() if element.get("id")}

    def patches(self) -> Iterator[Patch]:
        for scene in self._root.iter("visual_scene"):
            for node in scene.findall("node"):
                yield from self._node(node)

    def _at(self, address: str | None) -> ElementTree.Element:
        return self._named[(address or "").removeprefix("#")]

    def _node(self, node: ElementTree.Element) -> Iterator[Patch]:
        for instance in node.findall("instance_geometry"):
            targets = {item.get("symbol"): item.get("target") for item in instance.iter("instance_material")}
            for part in self._at(instance.get("url")).iter():
                if part.tag in ("triangles", "polylist"):
                    target = targets.get(part.get("material"))
                    yield Patch(self._colour(target) if target else None, self._count(part))
        for child in node.findall("node"):
            yield from self._node(child)
        for instance in node.findall("instance_node"):
            yield from self._node(self._at(instance.get("url")))

    def _colour(self, material: str) -> Colour | None:
        effect = self._at(self._at(material).find("instance_effect").get("url"))  # type: ignore[union-attr]
        found = effect.find(".//diffuse/color")
        if found is None:
            return None
        red, green, blue = (min(max(float(word), 0.0), 1.0) for word in (found.text or "").split()[:3])
        return red, green, blue, 1.0

    def _count(self, part: ElementTree.Element) -> int:
        """Triangles of a part; polygons are cut into them."""
        if part.tag == "polylist":
            corners = np.array((part.findtext("vcount") or "").split(), dtype=int)
            if np.any(corners != 3):
                return int(np.sum(corners - 2))
        places = self._places(part)
        alike = [
            np.all(places[:, one] == places[:, other], axis=1) for one, other in ((0, 1), (1, 2), (2, 0))
        ]
        return int(np.sum(~np.any(alike, axis=0)))

    def _places(self, part: ElementTree.Element) -> np.ndarray:
        """Corners of triangles, shape ``(n, 3, 3)``."""
        inputs = {item.get("semantic"): item for item in part.findall("input")}
        stride = 1 + max(int(item.get("offset", 0)) for item in part.findall("input"))
        vertices = self._at(inputs["VERTEX"].get("source"))
        positions = next(item for item in vertices.iter("input") if item.get("semantic") == "POSITION")
        numbers = self._at(positions.get("source")).findtext("float_array") or ""
        index = np.array((part.findtext("p") or "").split(), dtype=int).reshape(-1, 3, stride)
        place: np.ndarray = np.array(numbers.split(), dtype=float).reshape(-1, 3)
        return np.asarray(place[index[:, :, int(inputs["VERTEX"].get("offset", 0))]])
