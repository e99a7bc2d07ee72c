"""Body segments of the wearer and the sizes of the device that fit them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from twin_gait.parameters.quantities import NOT_NEGATIVE, POSITIVE, Length, Parameters, require
from twin_gait.parameters.wearer import SHANK_LENGTH, Patient
from twin_gait.vocabulary import SegmentModel, Sex

# Segment lengths as fractions of the body height: Drillis and Contini, in Winter (2009), fig. 4.1.
THIGH_LENGTH = 0.245
FOOT_LENGTH = 0.152
FOOT_HEIGHT = 0.039
HIP_BREADTH = 0.191
SHOULDER_BREADTH = 0.258  # twice the distance from the middle to a shoulder
UPPER_ARM_LENGTH = 0.186
FOREARM_LENGTH = 0.146  # distance from elbow to wrist
# Distances from the heel along the foot, as fractions of its length: the ankle (gait2d: 0.06 of 0.21 m) and
# the head of the second metatarsal (an assumption). That of the first one is at 0.74: ball of foot length
# 194.75 mm and foot length 263.03 mm, means of the 6068 soldiers of ANSUR II.
ANKLE_IN_FOOT = 0.25
METATARSAL_IN_FOOT = 0.72
# Distance from greater trochanter to shoulder: (0.818 - 0.530) H; centre of mass and radius of gyration of
# head, arms and trunk as fractions of it: Winter (2009), table 4.1.
SHOULDER_HEIGHT = TRUNK_LENGTH = 0.288
TRUNK_CENTRE_OF_MASS = 0.626
TRUNK_RADIUS_OF_GYRATION = 0.496

# Foot length of the wearer for whom the foot of a URDF is drawn [m] (an assumption; ours is, see
# urdf/README.md).
DRAWN_FOOT = FOOT_LENGTH * 1.75
_IDENTITY = np.eye(3)


class Segment(NamedTuple):
    """Body segment: mass as a fraction of body mass, lengths as fractions of the segment length."""

    mass: float  # share of the body mass
    centre_of_mass: float  # distance from the proximal end, share of the segment length
    transverse_radius: float  # radius of gyration about the medio-lateral axis, share of the length
    longitudinal_radius: float  # radius of gyration about the long axis, share of the length


# de Leva (1996), J Biomech 29(9), table 4: thigh HJC-KJC, shank KJC-AJC, foot HEEL-TTIP.
SEGMENTS: dict[Sex, dict[str, Segment]] = {
    Sex.MALE: {
        "thigh": Segment(0.1416, 0.4095, 0.329, 0.149),
        "shank": Segment(0.0433, 0.4395, 0.246, 0.102),
        "foot": Segment(0.0137, 0.4415, 0.245, 0.124),
    },
    Sex.FEMALE: {
        "thigh": Segment(0.1478, 0.3612, 0.364, 0.162),
        "shank": Segment(0.0481, 0.4352, 0.263, 0.092),
        "foot": Segment(0.0129, 0.4014, 0.279, 0.139),
    },
}

# Winter (2009), Biomechanics and Motor Control of Human Movement, table 4.1, after Dempster (1955): thigh
# greater trochanter to knee, shank knee to medial malleolus, foot lateral malleolus to second metatarsal. The
# table has one radius of gyration only; the longitudinal ones are those of de Leva's men, and have no effect
# on a leg that moves in its sagittal plane.
WINTER_SEGMENTS: dict[str, Segment] = {
    "thigh": Segment(0.100, 0.433, 0.323, 0.149),
    "shank": Segment(0.0465, 0.433, 0.302, 0.102),
    "foot": Segment(0.0145, 0.500, 0.475, 0.124),
}


class Subjects(NamedTuple):
    """Subjects of a segment table: mean and standard deviation of mass in [kg] and height in [m]."""

    description: str
    mass: tuple[float, float]
    height: tuple[float, float]


# De Leva (1996) adjusts tables of college-aged Caucasians (abstract). The means and deviations of 100 men and
# 15 women are recalled. Dempster (1955) dissected eight elderly men; their sizes are recalled.
SUBJECTS: dict[Sex, Subjects] = {
    Sex.MALE: Subjects("young men (de Leva 1996)", (73.0, 9.1), (1.741, 0.062)),
    Sex.FEMALE: Subjects("young women (de Leva 1996)", (61.9, 7.3), (1.735, 0.033)),
}
WINTER_SUBJECTS = Subjects("eight elderly men (Dempster 1955)", (60.0, 8.0), (1.70, 0.08))
_DEVIATIONS = 2.0  # standard deviations within which a wearer is like the subjects of a table


def wearer_notes(patient: Patient, heaviest: float | None = None) -> list[str]:
    """Return a sentence for each property of a wearer for which the model is extrapolated.

    The shares of mass and length are those of the subjects of the segment table, and constant: they change
    with growth and obesity. A wearer counts as extrapolated beyond two standard deviations of the subjects.

    Args:
        patient: The wearer.
        heaviest: Largest mass in [kg] for which the device is made, or None.

    Returns:
        Sentences; none for a wearer like the subjects.
    """
    winter = patient.segment_model is SegmentModel.WINTER
    subjects = WINTER_SUBJECTS if winter else SUBJECTS[patient.sex]
    outside = []
    for name, value, (mean, deviation), unit, digits in (
        ("mass", patient.mass, subjects.mass, "kg", 0),
        ("height", patient.height, subjects.height, "m", 2),
    ):
        low, high = (mean + sign * _DEVIATIONS * deviation for sign in (-1.0, 1.0))
        if not low <= value <= high:
            outside.append(f"{name} {value:g} {unit} (subjects {low:.{digits}f} to {high:.{digits}f} {unit})")
    notes = []
    if outside:
        notes.append(
            f"The body segments of the wearer are extrapolated from {subjects.description}: "
            f"{', '.join(outside)}."
        )
    if heaviest is not None and patient.mass > heaviest:
        notes.append(f"The wearer of {patient.mass:g} kg is heavier than the {heaviest:g} kg of the device.")
    return notes


def wearer_segments(patient: Patient) -> Mapping[str, Segment]:
    """Return thigh, shank and foot of a wearer, from the table that the wearer's segment model selects."""
    if patient.segment_model is SegmentModel.WINTER:
        return WINTER_SEGMENTS
    return SEGMENTS[patient.sex]


def foot_line(patient: Patient) -> tuple[np.ndarray, np.ndarray]:
    """Return the line on which a table measures the foot.

    The line ends half the foot's height below the ankle: de Leva's runs there from heel to tip of the toe,
    Winter's comes down from the ankle to the second metatarsal.

    Returns its start relative to the ankle, and the vector from start to end; both forward and up in [m],
    shapes ``(2,)``.
    """
    length = FOOT_LENGTH * patient.height
    drop = -0.5 * FOOT_HEIGHT * patient.height
    if patient.segment_model is SegmentModel.WINTER:
        return np.zeros(2), np.array([(METATARSAL_IN_FOOT - ANKLE_IN_FOOT) * length, drop])
    return np.array([-ANKLE_IN_FOOT * length, drop]), np.array([length, 0.0])


@dataclass(frozen=True, kw_only=True)
class ManufacturedSizes(Parameters):
    """Sizes in which a device is made, and the range of its adjustment.

    Attributes:
        femur: Distances from hip to knee in [m], from which the nearest one is chosen.
        waist: Distances between the hips in [m], from which the nearest one is chosen.
        waist_clearance: Clearance of both hip actuators next to the body in [m].
        tibia: Shortest and longest distance from knee to ankle in [m].
    """

    femur: Annotated[tuple[Length, ...], POSITIVE]
    waist: Annotated[tuple[Length, ...], POSITIVE]
    waist_clearance: Annotated[Length, NOT_NEGATIVE]
    tibia: Annotated[tuple[Length, Length], POSITIVE]

    def __post_init__(self) -> None:
        """Check the ranges, and that there is a size to choose from."""
        super().__post_init__()
        for name in ("femur", "waist"):
            require(bool(getattr(self, name)), f"sizes.{name}", "at least one size", [])
        require(self.tibia[0] <= self.tibia[1], "sizes.tibia", "the shortest length first", list(self.tibia))


@dataclass(frozen=True, kw_only=True)
class DeviceSizes:
    """Sizes to which the device is adjusted."""

    femur: float  # distance from hip to knee in [m]
    tibia: float  # distance from knee to ankle in [m]
    waist: float  # distance between the hips in [m]
    # Length of the wearer's foot in [m]. The foot plate is scaled from its drawn size by the ratio of this
    # length to ``DRAWN_FOOT``.
    foot: float
    heel_to_forefoot: float | None = None  # distance from heel to forefoot in [m]; None leaves it as drawn


def device_sizes(
    patient: Patient, manufactured: ManufacturedSizes | None = None, heel_to_forefoot: float | None = None
) -> DeviceSizes:
    """Return the sizes of the device for a wearer.

    The joints of wearer and device are assumed to be aligned: a difference between a manufactured size and
    the length of the wearer's segment is neglected.

    Args:
        patient: The wearer.
        manufactured: Sizes in which the device is made: femur and waist are the nearest ones, and the tibia
            is adjusted to the shank. None for a device that is made to measure, which has the lengths of the
            body.
        heel_to_forefoot: Distance of the points of a sole on the ground, as a share of the length of the
            foot; None leaves them as they are drawn.

    Returns:
        The sizes; the foot plate is always made for the foot.

    Raises:
        ParameterError: If the shank is outside the range of the tibia.
    """
    height = patient.height
    tibia, foot = SHANK_LENGTH * height, FOOT_LENGTH * height
    apart = None if heel_to_forefoot is None else heel_to_forefoot * foot
    if manufactured is None:
        femur, waist = THIGH_LENGTH * height, HIP_BREADTH * height
        return DeviceSizes(femur=femur, tibia=tibia, waist=waist, foot=foot, heel_to_forefoot=apart)
    low, high = manufactured.tibia
    least, most = math.ceil(1e3 * low / SHANK_LENGTH) / 1e3, math.floor(1e3 * high / SHANK_LENGTH) / 1e3
    expected = (
        f"{least:g} to {most:g} m, which the tibia follows from {low:g} to {high:g} m "
        "(any height with leg.sizes: null, for a device that is made to measure)"
    )
    require(low <= tibia <= high, "patient height", expected, height)
    thigh, hips = THIGH_LENGTH * height, HIP_BREADTH * height + manufactured.waist_clearance
    return DeviceSizes(
        femur=min(manufactured.femur, key=lambda size: abs(size - thigh)),
        tibia=tibia,
        waist=min(manufactured.waist, key=lambda size: abs(size - hips)),
        foot=foot,
        heel_to_forefoot=apart,
    )


def segment_inertia(
    segment: Segment, body_mass: float, axis: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Compute mass, centre of mass and rotational inertia of a limb segment.

    ``body_mass`` in [kg]. ``axis``: vector from the proximal to the distal joint in [m], shape ``(3,)``.
    Returns mass in [kg], centre of mass from the proximal joint in [m], shape ``(3,)``, and inertia about the
    centre of mass in [kg·m²], shape ``(3, 3)``.
    """
    mass = segment.mass * body_mass
    length = float(np.linalg.norm(axis))
    along = axis[:, None] * axis / (length * length)
    transverse = (segment.transverse_radius * length) ** 2
    longitudinal = (segment.longitudinal_radius * length) ** 2
    inertia = mass * (transverse * (_IDENTITY - along) + longitudinal * along)
    return mass, segment.centre_of_mass * axis, inertia


def trunk_mass(patient: Patient) -> float:
    """Compute the mass of head, arms and trunk with pelvis, which is the mass without the legs, in [kg]."""
    legs = 2.0 * sum(segment.mass for segment in wearer_segments(patient).values())
    return (1.0 - legs) * patient.mass
