"""Search and reading of URDF files, with error messages that name the cause and the remedy."""

import contextlib
import hashlib
import os
import tempfile
import threading
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path

import pinocchio as pin

from twin_gait.exceptions import ModelError
from twin_gait.files import read_bytes, shipped_file
from twin_gait.leg_model.urdf_document import joint_elements, urdf_text

_STDERR_LOCK = threading.Lock()
_STDERR = 2  # file descriptor of C, independent of Python's sys.stderr
PACKAGED_URDFS = ("twin.urdf", "twin_leg.urdf", "twin_ankle.urdf", "body.urdf")


def packaged_urdf(name: str) -> Path:
    """Return the path of a URDF that ships with the package, such as ``twin.urdf``, installed or not.

    Raises ModelError if there is no such file.
    """
    path = shipped_file(name) if name in PACKAGED_URDFS else None
    if path is None:
        expected = f"give a path, or one of {', '.join(PACKAGED_URDFS)}"
        raise ModelError(f"{name}: there is no such URDF file; {expected}")
    return path


def find_urdf(path_or_name: str | Path) -> Path:
    """Resolve a path, or the bare name of a packaged URDF.

    Raises ModelError if there is no such file.
    """
    path = Path(path_or_name).expanduser()
    return path if path.is_file() else packaged_urdf(str(path_or_name))


def kinematic_text(path: Path, turned: frozenset[str] = frozenset()) -> str:
    """Return a URDF as the text from which Pinocchio builds a model: links with their inertia, and joints.

    Visual and collision geometry, materials and transmissions are left out, so that none of them can make a
    leg unusable. Pinocchio gives a ``continuous`` joint two coordinates (cosine and sine); every law here
    acts on one angle, so such joints become revolute ones without limits.

    ``turned``: joints whose axis is reversed, and their limits with it. Raises ModelError if the file cannot
    be read or is not a URDF.
    """
    return _kinematic_text(urdf_text(path), turned)


@lru_cache(maxsize=16)  # a batch builds the same model thousands of times
def _kinematic_text(text: str, turned: frozenset[str]) -> str:
    root = _normalized(text, turned)
    for material in root.findall("material"):
        root.remove(material)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    return ElementTree.tostring(root, encoding="unicode")


def visual_document(path: Path) -> ElementTree.Element:
    """Return a URDF as the document from which Pinocchio reads its visual geometry.

    Raises ModelError if the file cannot be read or is not a URDF.
    """
    return _normalized(urdf_text(path))


def _normalized(text: str, turned: frozenset[str] = frozenset()) -> ElementTree.Element:
    """Return links, joints and materials of a URDF in the form that Pinocchio reads."""
    root = ElementTree.fromstring(text)
    for element in list(root):
        if element.tag not in ("link", "joint", "material"):
            root.remove(element)
    for name, joint in joint_elements(root).items():
        _normalize_joint(joint, turned=name in turned)
    return root


def _normalize_joint(joint: ElementTree.Element, *, turned: bool) -> None:
    """Convert a joint to the form that Pinocchio needs, and reverse its axis if it is turned."""
    for dynamics in joint.findall("dynamics"):
        joint.remove(dynamics)
    limit = joint.find("limit")
    if joint.get("type") == "continuous":
        joint.set("type", "revolute")
        if limit is None:
            limit = ElementTree.SubElement(joint, "limit", effort="1e3", velocity="1e3")
        limit.attrib |= {"lower": "-1e3", "upper": "1e3"}
    if limit is not None:
        # Pinocchio rejects a limit without these attributes; 0 means that no limit is stated.
        limit.attrib = {"effort": "0", "velocity": "0", **limit.attrib}
    if turned:
        axis = joint.find("axis")
        if axis is None:
            axis = ElementTree.SubElement(joint, "axis")
        # The difference 0 - x avoids that a zero becomes -0.
        axis.set("xyz", " ".join(repr(0.0 - float(word)) for word in axis.get("xyz", "1 0 0").split()))
        assert limit is not None  # the parser has read the file before
        low, high = (float(limit.get(end, "0")) for end in ("lower", "upper"))
        limit.attrib |= {"lower": repr(0.0 - high), "upper": repr(0.0 - low)}


def urdf_hash(path: Path) -> str:
    """Compute the SHA-256 hash of a URDF file's content, in hexadecimal."""
    return hashlib.sha256(read_bytes(path)).hexdigest()


def build_model(
    path: Path, root_joints: Sequence[tuple[pin.JointModel, str]] = (), turned: frozenset[str] = frozenset()
) -> pin.Model:
    """Build a Pinocchio model of a URDF file.

    ``root_joints``: joints between world and root link with their names; the root link is fixed without any.
    ``turned``: joints whose angle has the opposite sign of that in the file. Raises ModelError if Pinocchio
    rejects the file.
    """
    text = kinematic_text(path, turned)
    model, reason = None, ""
    with capture_stderr() as lines:
        try:
            model = _built(text, root_joints)
        except (ValueError, RuntimeError, IndexError) as error:
            reason = str(error) or type(error).__name__
    # The parser continues if it cannot read mass and inertia of a link, which then has no mass.
    errors = [line.removeprefix("Error:").strip() for line in lines if line.startswith("Error:")]
    errors = [line for line in errors if "is not initialized" not in line][:2]  # others are consequences
    if errors or model is None:
        reason = " ".join(("; ".join(errors) or reason).split())
        raise ModelError(f"{path}: Pinocchio cannot build a model from it ({reason})")
    return model


def _built(text: str, root_joints: Sequence[tuple[pin.JointModel, str]]) -> pin.Model:
    """Build a model with joints between world and root link."""
    if not root_joints:
        return pin.buildModelFromXML(text)
    *outer, (joint, name) = root_joints
    model = pin.buildModelFromXML(text, joint, name)
    for joint, name in reversed(outer):
        carrier = pin.Model()
        frame = carrier.addJointFrame(carrier.addJoint(0, joint, pin.SE3.Identity(), name))
        model = pin.appendModel(carrier, model, frame, pin.SE3.Identity())
    return model


@contextlib.contextmanager
def capture_stderr() -> Iterator[list[str]]:
    """Suppress the output of the C++ URDF parser to the file descriptor, and yield a list for its lines.

    The list is filled when the context ends. The descriptor belongs to the whole process, so only one thread
    at a time may swap it.
    """
    lines: list[str] = []
    with _STDERR_LOCK, contextlib.ExitStack() as restored:
        with contextlib.suppress(OSError):
            saved = os.dup(_STDERR)
            restored.callback(os.close, saved)
            kept = restored.enter_context(tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace"))
            restored.callback(lambda: lines.extend(kept.read().splitlines()))
            restored.callback(kept.seek, 0)  # callbacks run in reverse order, so this runs before the reading
            os.dup2(kept.fileno(), _STDERR)
            restored.callback(os.dup2, saved, _STDERR)
        yield lines
