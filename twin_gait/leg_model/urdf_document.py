"""XML of a URDF file: reading, checks of its structure and its numbers, mimic joints.

Only children of ``<robot>`` count as links and joints: ``<transmission>`` and extensions of simulators repeat
the names of joints. Collision geometry is never used.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from twin_gait.exceptions import ModelError
from twin_gait.files import read_bytes

GIT_LFS_POINTER = b"version https://git-lfs"  # first bytes of the placeholder of a large file
_NOT_NEGATIVE = ("value", "ixx", "iyy", "izz")  # attributes of a mass or an inertia
# Drawing programs export a zero inertia as -5e-20 (iCub's hip); a number that is negative by no more than
# this is such a zero.
_ROUNDING = 1e-12
# No robot has masses in [kg], inertias in [kg·m²] or distances in [m] beyond this; squares of them would
# overflow later on.
_LARGEST_NUMBER = 1e6
_MIMIC_DEFAULTS = {"multiplier": "1", "offset": "0"}


class UrdfWarning(UserWarning):
    """Warning that a URDF can be used, but some of its content is left out or contradicts the experiment."""


class Mimic(NamedTuple):
    """Coupling of a joint to another one: position = ``multiplier`` · position of ``joint`` + ``offset``."""

    joint: str
    multiplier: float  # ratio of the positions, 1 for equal ones
    offset: float  # position at zero of the other joint in [rad], or in [m] for a sliding joint


def urdf_document(path: Path) -> Element:
    """Read a URDF, check it, and return its element ``<robot>``, which the caller may change.

    Raises ModelError as :func:`urdf_text` does.
    """
    return ElementTree.fromstring(urdf_text(path))


def urdf_text(path: Path) -> str:
    """Read a URDF, check it, and return its text without collision geometry.

    ``path``: the file, in any encoding that its XML declares. Raises ModelError if the file cannot be read,
    is no URDF, or describes no tree of links.
    """
    try:
        data = read_bytes(path)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read ({error.strerror})") from error
    if data.startswith(GIT_LFS_POINTER):
        raise ModelError(f"{path}: is a Git LFS pointer instead of the file; get the file with: git lfs pull")
    return _checked_text(path, data)


@lru_cache(maxsize=16)  # a batch needs the same file thousands of times
def _checked_text(path: Path, data: bytes) -> str:
    try:
        root = ElementTree.fromstring(data)
        if root.tag != "robot":
            raise ValueError(f"the outer element is <{root.tag}>")
        for link in root.findall("link"):
            for collision in link.findall("collision"):
                link.remove(collision)
        _check_tree(path, root)
        _check_numbers(path, root)
        return ElementTree.tostring(root, encoding="unicode")
    except RecursionError as error:
        raise ModelError(f"{path}: not a URDF (elements are nested too deeply)") from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{path}: not a URDF ({error}); expected XML with a <robot> element") from error


def _check_tree(path: Path, root: Element) -> None:
    """Check that each link is the child of one joint at most."""
    carried: dict[str, str] = {}
    for joint in root.findall("joint"):
        child = joint.find("child")
        link = "" if child is None else child.get("link", "")
        name = joint.get("name", "")
        if link and link in carried:
            raise ModelError(
                f"{path}: link {link!r} is the child of joint {carried[link]!r} and of joint {name!r}; a "
                "URDF is a tree, so remove one of them (a closed loop of rods cannot be described)"
            )
        carried[link] = name


def _check_numbers(path: Path, root: Element) -> None:
    """Check the sign and the size of masses, inertias and distances."""
    for link in root.findall("link"):
        for element in link.iterfind("inertial/*"):
            location = f"{path}: link {link.get('name')!r}: {element.tag}"
            for key, number in _numbers(element):
                if abs(number) > _LARGEST_NUMBER:
                    limit = f"at most {_LARGEST_NUMBER:g} in SI units"
                    raise ModelError(f"{location} {key}: expected {limit}, got {element.get(key)!r}")
                if key in _NOT_NEGATIVE and number < -_ROUNDING:
                    raise ModelError(f"{location} {key}: expected 0 or more, got {element.get(key)!r}")
    for joint in root.findall("joint"):
        for origin in joint.findall("origin"):
            if any(abs(number) > _LARGEST_NUMBER for key, number in _numbers(origin) if key == "xyz"):
                limit = f"at most {_LARGEST_NUMBER:g} m"
                location = f"{path}: joint {joint.get('name')!r}: origin xyz"
                raise ModelError(f"{location}: expected {limit}, got {origin.get('xyz')!r}")


def _numbers(element: Element) -> Iterator[tuple[str, float]]:
    """Yield the numbers in the attributes of an element; other texts are left to Pinocchio's parser."""
    for key, text in element.items():
        for word in text.split():
            try:
                number = float(word)
            except ValueError:
                continue
            if not math.isnan(number):
                yield key, number


def joint_elements(root: Element) -> dict[str, Element]:
    """Return the joints of a URDF by name."""
    return {joint.get("name", ""): joint for joint in root.findall("joint")}


def mimic_joints(path: Path) -> dict[str, Mimic]:
    """Read the couplings of a URDF, by the name of the coupled joint.

    Raises ModelError if a multiplier or an offset is no number, or a chain of couplings does not end at a
    joint that moves by itself.
    """
    joints = joint_elements(urdf_document(path))
    found = {}
    for name, joint in joints.items():
        mimic = joint.find("mimic")
        if mimic is not None:
            try:
                ratio, offset = (float(mimic.get(key, default)) for key, default in _MIMIC_DEFAULTS.items())
            except ValueError as error:
                raise ModelError(f"{path}: joint {name!r}: <mimic>: {error}") from error
            found[name] = Mimic(mimic.get("joint", ""), ratio, offset)
    for name in found:
        chain = [name]
        while chain[-1] in found and chain.count(chain[-1]) == 1:
            chain.append(found[chain[-1]].joint)
        if chain[-1] in found or chain[-1] not in joints:
            problem = f"mimics {found[name].joint!r}; expected a joint that moves by itself at the end"
            raise ModelError(f"{path}: joint {name!r} {problem} of the chain {' -> '.join(chain)}")
    return found
