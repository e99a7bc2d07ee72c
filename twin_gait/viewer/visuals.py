"""Visual geometry of a URDF, as meshes in the frames of the joints of a model.

Pinocchio's reader of meshes leaves out normals, which are made anew, and the colours of COLLADA files, which
are read here.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from twin_gait.exceptions import ViewerError
from twin_gait.leg_model.joints import ALL_GUIDES
from twin_gait.leg_model.urdf import PACKAGED_URDFS, build_model, packaged_urdf, quiet_stderr, read_urdf
from twin_gait.viewer import shapes
from twin_gait.viewer.shapes import Shape

FIXED_JOINT = "universe"
_EDGE_SHARE, _LARGEST_EDGE = 0.22, 0.012  # rounding of boxes: share of the shortest side, [m]
# A part that spans this share of a segment belongs to the tube and grows with it; others only move.
_SPANNING_SHARE = 0.6


Colour = tuple[float, ...]  # red, green, blue and opacity from 0 to 1


class Disc(NamedTuple):
    """A cylinder among the visuals, in the frame of its joint."""

    joint: str  # joint that carries it
    centre: np.ndarray  # in [m], shape ``(3,)``
    axis: np.ndarray  # unit vector, shape ``(3,)``
    radius: float  # in [m]
    length: float  # in [m]


# Colour of neighbouring triangles in a mesh file, None where it has a texture or nothing, and their number.
Patch = tuple[Colour | None, int]


class LinkPart(NamedTuple):
    """All visuals of one colour on one joint."""

    joint: str  # joint that carries them; ``universe`` for what does not move
    colour: Colour
    shape: Shape  # mesh in the frame of the joint


@dataclass(frozen=True)
class Visuals:
    """What a URDF shows."""

    parts: tuple[LinkPart, ...]  # the meshes
    discs: tuple[Disc, ...]  # its cylinders, among which are the motors
    missing: tuple[str, ...]  # mesh files that the URDF names and that are not there


def load_visuals(model: pin.Model, urdf: Path) -> Visuals:
    """Load the visual geometry of a URDF for a model that was built from it.

    The model may have locked joints, a joint between world and pelvis, and resized segments and feet: parts
    move and grow with what carries them. Raises ModelError if the URDF cannot be read. Raises ViewerError if
    a mesh cannot be read.
    """
    text, missing = _read_with_meshes(urdf)
    nominal, geometry = _nominal(model, urdf, text)
    stretches = {name: _stretch(nominal, model, name) for name in nominal.names}
    growths = {name: _growth(nominal, model, name) for name in nominal.names}
    guides = [name for name in ALL_GUIDES if model.existJointName(name)]
    carrier = {FIXED_JOINT: guides[-1]} if guides else {}
    shapes_by_colour: dict[tuple[str, Colour], list[Shape]] = {}
    discs = []
    for item in geometry.geometryObjects:
        raw = _shape_of(item)
        if raw is None:
            continue
        nominal_joint = str(nominal.names[item.parentJoint])
        joint = carrier.get(nominal_joint, nominal_joint)
        growth = np.diag([*[growths[nominal_joint]] * 3, 1.0])
        shape, shift = _fit(shapes.moved(raw, growth @ item.placement.homogeneous), stretches[nominal_joint])
        for colour, piece in _coloured(item, shape):
            shapes_by_colour.setdefault((joint, tuple(round(value, 4) for value in colour)), []).append(piece)
        if type(item.geometry).__name__ == "Cylinder":
            size, solid = growths[nominal_joint], item.geometry
            centre, axis = size * item.placement.translation + shift, item.placement.rotation[:, 2].copy()
            discs.append(Disc(joint, centre, axis, size * solid.radius, 2.0 * size * solid.halfLength))
    parts = [LinkPart(*key, shapes.merged(items)) for key, items in shapes_by_colour.items()]
    return Visuals(tuple(parts), tuple(discs), tuple(missing))


def _read_with_meshes(urdf: Path) -> tuple[str, list[str]]:
    """URDF text with absolute mesh paths, and the meshes that were not found and left out."""
    root = ElementTree.fromstring(read_urdf(urdf))
    missing = _resolve_meshes(root, urdf)
    _drop_colourless(root)
    if root.find(".//capsule") is not None:
        root.set("version", "1.2")  # Pinocchio overlooks capsules in a file of version 1.0
    return ElementTree.tostring(root, encoding="unicode"), missing


def _drop_colourless(root: ElementTree.Element) -> None:
    """Take out materials that have a texture and no colour: Pinocchio would make them black."""
    coloured = {item.get("name") for item in root.iter("material") if item.find("color") is not None}
    for visual in root.iter("visual"):
        for material in visual.findall("material"):
            if material.get("name") not in coloured:
                visual.remove(material)


def _resolve_meshes(root: ElementTree.Element, urdf: Path) -> list[str]:
    """Make mesh paths absolute; take out the visuals whose mesh is not there, and name them."""
    missing = []
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            found = _find_mesh(name, urdf.parent)
            if found is None:
                missing.append(name)
                link.remove(visual)
            else:
                mesh.set("filename", str(found))
    return missing


def _find_mesh(name: str, folder: Path) -> Path | None:
    relative = name.removeprefix("package://").removeprefix("file://")
    inside_package = relative.split("/", 1)[-1] if name.startswith("package://") else relative
    # A copy of a packaged URDF keeps its looks without a copy of the meshes.
    folders = (folder, *folder.resolve().parents, packaged_urdf(PACKAGED_URDFS[0]).parent)
    nearby = (base / part for base in folders for part in (relative, inside_package))
    return next((path.resolve() for path in (Path(relative), *nearby) if path.is_file()), None)


def _nominal(model: pin.Model, urdf: Path, text: str) -> tuple[pin.Model, pin.GeometryModel]:
    """Model and visuals as the file has them, without the joints that the given model lacks."""
    nominal = build_model(urdf)
    try:
        with quiet_stderr():
            geometry = pin.buildGeomFromUrdfString(nominal, text, pin.GeometryType.VISUAL)
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise ViewerError(f"{urdf}: its visual meshes cannot be read ({reason})") from error
    locked = [index for index, name in enumerate(nominal.names) if index and not model.existJointName(name)]
    if locked:
        nominal, geometry = pin.buildReducedModel(nominal, geometry, locked, pin.neutral(nominal))
    return nominal, geometry


def _stretch(nominal: pin.Model, model: pin.Model, joint: str) -> tuple[np.ndarray, float, float] | None:
    """Direction, ratio and length of the segment that a joint carries, if the model resized it."""
    parent = nominal.getJointId(joint) if joint != FIXED_JOINT else 0
    for child in range(1, nominal.njoints):
        name = nominal.names[child]
        if nominal.parents[child] != parent or not model.existJointName(name):
            continue
        old = np.asarray(nominal.jointPlacements[child].translation)
        change = np.asarray(model.jointPlacements[model.getJointId(name)].translation) - old
        size = float(np.linalg.norm(change))
        if size > 1e-9:
            direction = change / size
            length = float(old @ direction)
            if length != 0.0:
                return direction, 1.0 + size / length, abs(length)
    return None


def _growth(nominal: pin.Model, model: pin.Model, joint: str) -> float:
    """How much farther from its joint a frame lies than in the file; 1 but for those of a fitted foot."""
    for frame in nominal.frames:
        distance = float(np.linalg.norm(frame.placement.translation))
        if str(nominal.names[frame.parentJoint]) == joint and distance > 0.0 and model.existFrame(frame.name):
            now = model.frames[model.getFrameId(frame.name)].placement.translation
            return float(np.linalg.norm(now)) / distance
    return 1.0


def _fit(shape: Shape, stretch: tuple[np.ndarray, float, float] | None) -> tuple[Shape, np.ndarray]:
    """Move a part with its segment and lengthen it if it spans it; also by how much it moved."""
    if stretch is None:
        return shape, np.zeros(3)
    direction, ratio, length = stretch
    along = shape.vertices @ direction
    if np.ptp(along) >= _SPANNING_SHARE * length:
        vertices = shape.vertices + (ratio - 1.0) * np.outer(along, direction)
        return shape._replace(vertices=vertices), np.zeros(3)
    shift = (ratio - 1.0) * 0.5 * float(along.min() + along.max()) * direction
    return shape._replace(vertices=shape.vertices + shift), shift


def _coloured(item: Any, shape: Shape) -> Iterator[tuple[Colour, Shape]]:
    """Pieces of a visual by colour: the URDF's, or if it has none those of the mesh file."""
    stated: Colour = tuple(float(value) for value in item.meshColor)
    own = not item.overrideMaterial and str(item.meshPath).lower().endswith(".dae")
    patches = dae_patches(Path(item.meshPath)) if own else []
    counts = [triangles for _, triangles in patches]
    if sum(counts) != len(shape.faces):  # none, or read differently
        yield stated, shape
        return
    colours = [colour or stated for colour, _ in patches]
    number = np.repeat([colours.index(colour) for colour in colours], counts)
    for one in np.unique(number):
        yield colours[one], shapes.part_of(shape, number == one)


def _shape_of(item: Any) -> Shape | None:
    """Mesh of a visual in its own frame, with the edges of primitives softened."""
    solid = item.geometry
    match type(solid).__name__:
        case "Box":
            size = 2.0 * np.asarray(solid.halfSide)
            return shapes.rounded_box(size.tolist(), min(_EDGE_SHARE * float(size.min()), _LARGEST_EDGE))
        case "Cylinder":
            return shapes.cylinder(float(solid.radius), 2.0 * float(solid.halfLength))
        case "Sphere":
            return shapes.ellipsoid((float(solid.radius),) * 3)
        case "Capsule":
            return shapes.capsule(float(solid.radius), 2.0 * float(solid.halfLength))
    if not hasattr(solid, "tri_indices") or solid.num_tris == 0:
        return None
    vertices = np.array(solid.vertices(), dtype=float)  # scaled already
    triangles = (solid.tri_indices(index) for index in range(solid.num_tris))
    faces = np.array([[corner[0], corner[1], corner[2]] for corner in triangles], dtype=int)
    mirrored = float(np.prod(item.meshScale)) < 0.0
    return shapes.creased(vertices, faces[:, ::-1] if mirrored else faces)


def dae_patches(path: Path) -> list[Patch]:
    """Colours that a COLLADA file has of its own, in the order in which its triangles are listed.

    Pinocchio's reader goes through the nodes of the scene from the outside in and leaves out triangles of
    which two corners coincide. Returns the patches; none for a file that is not understood.
    """
    try:
        return list(_Collada(path).patches())
    except (OSError, ElementTree.ParseError, ValueError, IndexError, AttributeError, TypeError, KeyError):
        return []


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
                    yield self._colour(target) if target else None, self._count(part)
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
