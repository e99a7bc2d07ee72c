"""Visual geometry of a URDF, as meshes in the frames of the joints of a model.

Pinocchio's reader of meshes ignores normals, which are computed again, and the colours of COLLADA files,
which are read here.
"""

from __future__ import annotations

import hashlib
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from twin_gait.exceptions import ViewerError
from twin_gait.leg_model.joints import ALL_GUIDES
from twin_gait.leg_model.urdf import (
    PACKAGED_URDFS,
    build_model,
    capture_stderr,
    packaged_urdf,
    visual_document,
)
from twin_gait.leg_model.urdf_document import GIT_LFS_POINTER, UrdfWarning
from twin_gait.viewer import shapes
from twin_gait.viewer.shapes import Shape

FIXED_JOINT = "universe"
_EDGE_SHARE, _LARGEST_EDGE = 0.22, 0.012  # rounding of boxes: share of the shortest side; limit in [m]

Colour = tuple[float, ...]  # red, green, blue and opacity from 0 to 1
# Colour of consecutive triangles in a mesh file, None for a texture or no colour, and their number.
Patch = tuple[Colour | None, int]


class LinkPart(NamedTuple):
    """All visuals of one colour on one joint."""

    joint: str  # name of the joint; ``universe`` for fixed parts
    colour: Colour
    shape: Shape  # mesh in the frame of the joint


def load_visuals(model: pin.Model, urdf: Path) -> list[LinkPart]:
    """Load the visual geometry of a URDF for a model that was built from it.

    The model may have locked joints, joints between world and pelvis, and resized segments and feet, with
    which their parts are scaled. A visual that cannot be read, such as a missing mesh, is omitted with a
    warning. Raises ModelError if the URDF cannot be read, and ViewerError if none of its visuals can.
    """
    nominal, geometry = _nominal(model, urdf)
    guides = [name for name in ALL_GUIDES if model.existJointName(name)]
    carrier = {FIXED_JOINT: guides[-1]} if guides else {}
    found: dict[tuple[str, Colour], list[Shape]] = {}
    for item in geometry.geometryObjects:
        raw, joint = _make_mesh(item), str(nominal.names[item.parentJoint])
        if raw is not None:
            placement = _link_scaling(nominal, model, item.parentJoint) @ item.placement.homogeneous
            for colour, piece in _split_by_colour(item, shapes.transform_mesh(raw, placement)):
                rounded = tuple(round(value, 4) for value in colour)
                found.setdefault((carrier.get(joint, joint), rounded), []).append(piece)
    return [LinkPart(*key, shapes.merge_meshes(items)) for key, items in found.items()]


def _located_visuals(urdf: Path) -> ElementTree.Element:
    """Read a URDF and write absolute paths into its meshes; missing meshes are omitted with a warning."""
    root = visual_document(urdf)
    defined: set[str] = set()
    for material in root.findall("material"):
        name = material.get("name", "")
        if name in defined:  # Pinocchio rejects a second material of the same name
            root.remove(material)
        defined.add(name)
    coloured = {item.get("name", "") for item in root.iter("material") if item.find("color") is not None}
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            for material in visual.findall("material"):
                # Pinocchio would draw a material with a texture and without a colour in black.
                if material.get("name") not in coloured:
                    visual.remove(material)
    _remove_unreadable(root, urdf, partial(_locate, urdf))
    return root


def _remove_unreadable(
    root: ElementTree.Element, urdf: Path, find_problem: Callable[[ElementTree.Element], str]
) -> None:
    """Remove the visuals that have a problem, with a warning for each of them."""
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            problem = find_problem(visual)
            if problem:
                warnings.warn(f"{urdf}: {problem}; it is not drawn", UrdfWarning, stacklevel=2)
                link.remove(visual)


def _locate(urdf: Path, visual: ElementTree.Element) -> str:
    """Write the absolute path and the scale in [m] of the mesh of a visual, or return the problem."""
    mesh = visual.find("geometry/mesh")
    if mesh is None:
        return ""
    name = mesh.get("filename", "")
    found = _find_mesh(name, urdf.parent)
    if found is None:
        return f"mesh {name} does not exist"
    with found.open("rb") as file:
        if file.read(len(GIT_LFS_POINTER)) == GIT_LFS_POINTER:
            return f"mesh {name} is a Git LFS pointer (get the file with: git lfs pull)"
    mesh.set("filename", str(found))
    unit = collada_unit(found) if found.suffix.lower() == ".dae" else 1.0
    if unit != 1.0:
        scales = mesh.get("scale", "1 1 1").split()
        mesh.set("scale", " ".join(repr(unit * float(scale)) for scale in scales))
    return ""


def collada_unit(path: Path) -> float:
    """Return the length of the unit of a COLLADA file in [m]; 1 if it states none."""
    try:
        for _, element in ElementTree.iterparse(path, events=("start",)):
            name = element.tag.rpartition("}")[2]
            if name == "unit":
                unit = float(element.get("meter", "1"))
                return unit if unit > 0.0 else 1.0
            if name.startswith("library_"):  # the asset comes before the content
                break
    except (OSError, ElementTree.ParseError, ValueError):
        pass  # the reader of the mesh states the reason
    return 1.0


def _geometry(model: pin.Model, root: ElementTree.Element) -> pin.GeometryModel | None:
    """Read the visuals of a URDF; None if one of them cannot be read."""
    text = ElementTree.tostring(root, encoding="unicode")
    with capture_stderr() as printed:
        try:
            geometry = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.VISUAL)
        except (ValueError, RuntimeError):
            return None
    return None if any(line.startswith("Error:") for line in printed) else geometry


def _find_read_error(visual: ElementTree.Element) -> str:
    """Return the reason why Pinocchio cannot read a visual, or an empty text."""
    robot = ElementTree.Element("robot", name="trial")
    link = ElementTree.SubElement(robot, "link", name="link")
    ElementTree.SubElement(link, "visual").extend(visual.findall("origin") + visual.findall("geometry"))
    text = ElementTree.tostring(robot, encoding="unicode")
    reason = ""
    with capture_stderr() as printed:
        try:
            pin.buildGeomFromUrdfString(pin.buildModelFromXML(text), text, pin.GeometryType.VISUAL)
        except (ValueError, RuntimeError) as error:
            reason = str(error).partition("message:")[2].partition("Hint:")[0]
    reasons = [line.removeprefix("Error:") for line in printed if line.startswith("Error:")]
    reason = " ".join((reasons[0] if reasons else reason).split())
    shape = visual.find("geometry/*")
    kind = "a visual" if shape is None else shape.get("filename", f"a visual <{shape.tag}>")
    return f"{kind} cannot be read ({reason})" if reason else ""


def stored_mesh(name: str, folder: Path) -> Path:
    """Return the path of the copy of a mesh, by its name in a URDF that was copied unchanged to ``folder``.

    The name may be an address or a path outside of the folder; a hash of it distinguishes the copies.
    """
    mark = hashlib.sha256(name.encode()).hexdigest()[:8]
    return folder / "meshes" / f"{mark}-{Path(name).name}"


def mesh_files(urdf: Path) -> dict[str, Path]:
    """Return the files of the visual meshes of a URDF by their names in it, without those that are missing.

    Raises ModelError if the URDF cannot be read.
    """
    meshes = visual_document(urdf).iterfind("link/visual/geometry/mesh")
    found = {name: _find_mesh(name, urdf.parent) for name in (item.get("filename", "") for item in meshes)}
    return {name: path for name, path in found.items() if path is not None}


def _find_mesh(name: str, folder: Path) -> Path | None:
    relative = name.removeprefix("package://").removeprefix("file://")
    inside_package = relative.split("/", 1)[-1] if name.startswith("package://") else relative
    # A copy of a packaged URDF keeps its meshes without copying them.
    folders = (folder, *folder.resolve().parents, packaged_urdf(PACKAGED_URDFS[0]).parent)
    nearby = (base / part for base in folders for part in (relative, inside_package))
    candidates = (stored_mesh(name, folder), Path(relative), *nearby)
    return next((path.resolve() for path in candidates if path.is_file()), None)


def _nominal(model: pin.Model, urdf: Path) -> tuple[pin.Model, pin.GeometryModel]:
    """Build the model and the visuals of a URDF with its own dimensions.

    Joints that are missing in ``model`` are locked. Raises ViewerError if the visuals cannot be read.
    """
    nominal, root = build_model(urdf), _located_visuals(urdf)
    geometry = _geometry(nominal, root)
    if geometry is None:
        _remove_unreadable(root, urdf, _find_read_error)
        geometry = _geometry(nominal, root)
    if geometry is None:
        raise ViewerError(f"{urdf}: its visuals cannot be read; remove them, or correct their numbers")
    locked = [index for index, name in enumerate(nominal.names) if index and not model.existJointName(name)]
    if locked:
        nominal, geometry = pin.buildReducedModel(nominal, geometry, locked, pin.neutral(nominal))
    return nominal, geometry


def _link_scaling(nominal: pin.Model, model: pin.Model, index: int) -> np.ndarray:
    """Compute the scaling of the link of a joint from the file to the model, shape ``(4, 4)``.

    A link between two joints is scaled along the vector between them; the last link of a leg is scaled in all
    directions by the distance of its frame from the joint.
    """
    scaling = np.eye(4)
    for child in range(1, nominal.njoints):
        name, old = nominal.names[child], np.asarray(nominal.jointPlacements[child].translation)
        if nominal.parents[child] == index and model.existJointName(name):
            change = np.asarray(model.jointPlacements[model.getJointId(name)].translation) - old
            if abs(old @ change) > 1e-9:
                scaling[:3, :3] += np.outer(change, change) / (old @ change)
                return scaling
    for frame in nominal.frames:
        distance = float(np.linalg.norm(frame.placement.translation))
        if frame.parentJoint == index and distance > 0.0 and model.existFrame(frame.name):
            now = model.frames[model.getFrameId(frame.name)].placement.translation
            scaling[:3, :3] *= float(np.linalg.norm(now)) / distance
            return scaling
    return scaling


def _split_by_colour(item: Any, shape: Shape) -> Iterator[tuple[Colour, Shape]]:
    """Yield the parts of a visual by colour: the colour in the URDF, or else those in the mesh file."""
    stated: Colour = tuple(float(value) for value in item.meshColor)
    own_materials = not item.overrideMaterial and str(item.meshPath).lower().endswith(".dae")
    patches = dae_patches(Path(item.meshPath)) if own_materials else []
    counts = [triangles for _, triangles in patches]
    if sum(counts) != len(shape.faces):  # there are no patches, or Pinocchio counts the triangles differently
        yield stated, shape
        return
    colours = [colour or stated for colour, _ in patches]
    number = np.repeat([colours.index(colour) for colour in colours], counts)
    for one in np.unique(number):
        yield colours[one], shapes.select_faces(shape, number == one)


def _make_mesh(item: Any) -> Shape | None:
    """Return the mesh of a visual in its own frame, with rounded edges of primitives; None if it is empty."""
    solid = item.geometry
    match type(solid).__name__:
        case "Box":
            size = 2.0 * np.asarray(solid.halfSide)
            return shapes.rounded_box(size.tolist(), min(_EDGE_SHARE * float(size.min()), _LARGEST_EDGE))
        case "Cylinder":
            return shapes.cylinder(float(solid.radius), 2.0 * float(solid.halfLength))
        case "Sphere":
            return shapes.ball(float(solid.radius))
    if not hasattr(solid, "tri_indices") or solid.num_tris == 0:
        return None
    vertices = np.array(solid.vertices(), dtype=float)  # already scaled
    triangles = (solid.tri_indices(index) for index in range(solid.num_tris))
    faces = np.array([[corner[0], corner[1], corner[2]] for corner in triangles], dtype=int)
    mirrored = float(np.prod(item.meshScale)) < 0.0
    return shapes.compute_normals(vertices, faces[:, ::-1] if mirrored else faces)


def dae_patches(path: Path) -> list[Patch]:
    """Read the colours in a COLLADA 1.4 file in the order of its triangles.

    The order is that of Pinocchio's reader, which visits a node of the scene before the nodes in it. The
    reader omits triangles with two coincident corners. Returns the patches, or an empty list for a file that
    cannot be interpreted.
    """
    try:
        root = ElementTree.parse(path).getroot()
        for element in root.iter():
            element.tag = element.tag.rpartition("}")[2]
        named = {f"#{element.get('id')}": element for element in root.iter()}
        return [patch for node in root.findall(".//visual_scene/node") for patch in _patches(node, named)]
    except (OSError, ElementTree.ParseError, ValueError, IndexError, AttributeError, TypeError, KeyError):
        return []


def _patches(node: Any, named: Mapping[str, Any]) -> Iterator[Patch]:
    """Yield the patches of a node and of the nodes in it; ``named``: elements by their addresses."""
    for instance in node.findall("instance_geometry"):
        targets = {item.get("symbol"): item.get("target") for item in instance.iter("instance_material")}
        for part in named[instance.get("url")].iter():
            if part.tag in ("triangles", "polylist"):
                target = targets.get(part.get("material"))
                yield _colour(target, named) if target else None, _triangles(part, named)
    inner = [named[instance.get("url")] for instance in node.findall("instance_node")]
    for child in (*node.findall("node"), *inner):
        yield from _patches(child, named)


def _colour(material: str, named: Mapping[str, Any]) -> Colour | None:
    effect = named[named[material].find("instance_effect").get("url")]
    words = (effect.findtext(".//diffuse/color") or "").split()
    return (*(min(max(float(word), 0.0), 1.0) for word in words[:3]), 1.0) if words else None


def _triangles(part: Any, named: Mapping[str, Any]) -> int:
    """Count the triangles of a part with three different corners; polygons are divided into triangles."""
    corners = np.array((part.findtext("vcount") or "").split(), dtype=int)
    if np.any(corners != 3):
        return int(np.sum(corners - 2))
    inputs = {item.get("semantic"): item for item in part.findall("input")}
    stride = 1 + max(int(item.get("offset", 0)) for item in part.findall("input"))
    positions = named[inputs["VERTEX"].get("source")].find("input[@semantic='POSITION']").get("source")
    points: np.ndarray = np.array((named[positions].findtext("float_array") or "").split(), dtype=float)
    index = np.array((part.findtext("p") or "").split(), dtype=int).reshape(-1, 3, stride)
    corner_points = points.reshape(-1, 3)[index[:, :, int(inputs["VERTEX"].get("offset", 0))]]
    alike = np.all(corner_points == np.roll(corner_points, 1, axis=1), axis=2)
    return int(np.sum(~np.any(alike, axis=1)))
