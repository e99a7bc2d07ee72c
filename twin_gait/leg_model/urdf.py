"""Find and read URDF files, with errors that help."""

import contextlib
import hashlib
import math
import os
import tempfile
import threading
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterator, Sequence
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import IO

import pinocchio as pin

from twin_gait.exceptions import ModelError
from twin_gait.files import shipped_file

_SILENCE = threading.Lock()
# Drawing programs export a zero inertia as -5e-20 (iCub's hip); this much below zero is such a zero.
_ROUNDING = 1e-12
PACKAGED_URDFS = ("twin.urdf", "twin_leg.urdf", "twin_ankle.urdf")


def packaged_urdf(name: str) -> Path:
    """Path of a URDF that ships with the package, installed or in a checkout.

    ``name``: file name, for example ``twin.urdf``. Returns path of the file. Raises ModelError if there is no
    such file.
    """
    path = shipped_file(name)
    if path is None:
        raise ModelError(f"no URDF {name!r} ships with twin_gait; there are {', '.join(PACKAGED_URDFS)}")
    return path


def find_urdf(path_or_name: str | Path) -> Path:
    """Resolve a path, or the bare name of a packaged URDF.

    ``path_or_name``: path of a file, or for example ``twin.urdf``. Raises ModelError if there is no such
    file.
    """
    path = Path(path_or_name).expanduser()
    if path.is_file():
        return path
    if str(path_or_name) in PACKAGED_URDFS:
        return packaged_urdf(str(path_or_name))
    raise ModelError(f"{path}: no such URDF file; give a path, or one of {', '.join(PACKAGED_URDFS)}")


def read_urdf(path: Path) -> str:
    """Read a URDF as text, check that it is XML, and unwrap continuous joints.

    Pinocchio gives a ``continuous`` joint two coordinates (cosine and sine). Every law here acts on
    one angle, so such joints become revolute ones without limits.

    Raises ModelError if the file cannot be read or is not a URDF.
    """
    try:
        return _checked_text(path, path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelError(
            f"{path}: cannot be read ({error.strerror}); check the path and its rights"
        ) from error
    except UnicodeDecodeError as error:
        raise _not_a_urdf(path, error) from error


@lru_cache(maxsize=16)  # a batch asks for the same file thousands of times
def _checked_text(path: Path, text: str) -> str:
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise _not_a_urdf(path, error) from error
    if root.tag != "robot":
        raise ModelError(f"{path}: not a URDF: the outer element is <{root.tag}>, expected <robot>")
    for link in root.iter("link"):
        _check_inertial(path, link)
    for joint in root.iter("joint"):
        _check_axis(path, joint)
        _check_limit(path, joint)
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ElementTree.SubElement(joint, "limit", effort="1e3", velocity="1e3")
            limit.set("lower", "-1e3")
            limit.set("upper", "1e3")
    return ElementTree.tostring(root, encoding="unicode")


def _not_a_urdf(path: Path, error: Exception) -> ModelError:
    return ModelError(f"{path}: not a URDF ({error}); expected XML with a <robot> element")


def _number(text: str) -> float:
    """A number, NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _check_axis(path: Path, joint: ElementTree.Element) -> None:
    """Refuse an axis that is not three numbers or has no direction, where the joint turns or slides."""
    axis = joint.find("axis")
    if axis is None or joint.get("type") not in ("revolute", "continuous", "prismatic"):
        return
    text = axis.get("xyz", "1 0 0")
    values = [_number(word) for word in text.split()]
    if len(values) != 3 or not any(values) or not all(map(math.isfinite, values)):
        raise ModelError(
            f"{path}: axis of joint {joint.get('name')!r}: expected three numbers, not all zero, got {text!r}"
        )


def _check_limit(path: Path, joint: ElementTree.Element) -> None:
    """Refuse a revolute or sliding joint without limits, of which the parser makes nothing."""
    kind = joint.get("type")
    if kind in ("revolute", "prismatic") and joint.find("limit") is None:
        other = "; a joint without stops is continuous" if kind == "revolute" else ""
        raise ModelError(
            f"{path}: joint {joint.get('name')!r} is {kind} and has no <limit>; give it one with lower, "
            f"upper (in {'rad' if other else 'm'}), effort and velocity{other}"
        )


def _check_inertial(path: Path, link: ElementTree.Element) -> None:
    """Refuse masses and inertias that the URDF parser would drop or take as they are.

    It leaves out an inertia that it cannot read, or half of which is missing, and the link weighs nothing.
    """
    needed = {"mass": ("value",), "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
    for inertial, (name, keys) in product(link.findall("inertial"), needed.items()):
        element = inertial.find(name)
        lacks = f"<{name}>" if element is None else " ".join(key for key in keys if element.get(key) is None)
        if lacks:
            raise ModelError(
                f"{path}: inertial of link {link.get('name')!r} has no {lacks}, and the link would weigh "
                "nothing; give mass and inertia, or no <inertial> where that is meant"
            )
    for element in (*link.findall("inertial/mass"), *link.findall("inertial/inertia")):
        for key, text in element.items():
            value = _number(text)
            may_be_negative = element.tag == "inertia" and key in ("ixy", "ixz", "iyz")
            if not math.isfinite(value) or (value < -_ROUNDING and not may_be_negative):
                raise ModelError(
                    f"{path}: {element.tag} {key} of link {link.get('name')!r}: "
                    f"expected a finite number of 0 or more, got {text!r}"
                )


def urdf_hash(path: Path) -> str:
    """SHA-256 of a URDF file's content, in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def build_model(
    path: Path, root_joints: Sequence[tuple[pin.JointModel, str]] = (), reversed_joints: Collection[str] = ()
) -> pin.Model:
    """Build a Pinocchio model of a URDF file.

    ``root_joints``: joints between world and root link with their names; none fixes the root link.
    ``reversed_joints``: joints whose angle is counted the other way than in the file. Raises ModelError if
    Pinocchio refuses the file.
    """
    text = read_urdf(path)
    if reversed_joints:
        text = _with_reversed(text, reversed_joints)
    said: list[str] = []
    try:
        with quiet_stderr(said):
            if not root_joints:
                return pin.buildModelFromXML(text)
            *outer, (joint, name) = root_joints
            model = pin.buildModelFromXML(text, joint, name)
            for joint, name in reversed(outer):
                carrier = pin.Model()
                place = carrier.addJoint(0, joint, pin.SE3.Identity(), name)
                frame = carrier.addJointFrame(place)
                model = pin.appendModel(carrier, model, frame, pin.SE3.Identity())
            return model
    except (ValueError, RuntimeError, IndexError) as error:
        told = [line.removeprefix("Error:").strip() for line in said if line.startswith("Error:")]
        told = [line for line in told if "is not initialized" not in line][:2]  # the rest is what came of it
        reason = " ".join(("; ".join(told) or str(error)).split()) or type(error).__name__
        raise ModelError(f"{path}: Pinocchio cannot build a model from it ({reason})") from error


def _with_reversed(text: str, names: Collection[str]) -> str:
    """URDF text in which some joints turn about the opposite axis, limits turned with them."""
    root = ElementTree.fromstring(text)
    for joint in root.iter("joint"):
        if joint.get("name") not in names:
            continue
        axis = joint.find("axis")
        if axis is None:
            axis = ElementTree.SubElement(joint, "axis")
        # 0 - x, so that no zero becomes -0.
        axis.set("xyz", " ".join(repr(0.0 - float(word)) for word in axis.get("xyz", "1 0 0").split()))
        limit = joint.find("limit")
        if limit is not None:
            low, high = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
            limit.set("lower", repr(0.0 - high))
            limit.set("upper", repr(0.0 - low))
    return ElementTree.tostring(root, encoding="unicode")


@contextlib.contextmanager
def quiet_stderr(said: list[str] | None = None) -> Iterator[None]:
    """Silence the C++ URDF parser, which prints to the file descriptor before it raises.

    The descriptor belongs to the whole process, so only one thread at a time may swap it. ``said``: gets the
    lines that were printed.
    """
    with _SILENCE, contextlib.ExitStack() as restored:
        with contextlib.suppress(OSError):
            descriptor = 2  # C's own, whatever Python's stands for
            saved = os.dup(descriptor)
            restored.callback(os.close, saved)
            kept = restored.enter_context(tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace"))
            restored.callback(lambda: said.extend(_lines_of(kept)) if said is not None else None)
            os.dup2(kept.fileno(), descriptor)
            restored.callback(os.dup2, saved, descriptor)
        yield


def _lines_of(file: IO[str]) -> list[str]:
    file.seek(0)
    return file.read().splitlines()
