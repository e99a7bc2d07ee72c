"""A chair, and what of the body meets it."""

from dataclasses import dataclass
from typing import Annotated

from twin_gait.parameters import quantities


@dataclass(frozen=True, kw_only=True)
class ChairParameters(quantities.Parameters):
    """A seat without a back; :mod:`twin_gait.core.seat` has the law. Shanks do not meet it.

    Attributes:
        height: Of the seat in [m]; 0.43 in a chair of OpenSim, 0.48 to 0.53 as a rule in wheelchairs.
        front: Place of its front edge in [m]; the hips begin at 0.
        behind: Way of its front edge behind the hips of a standing wearer, where somebody puts it when the
            device announces that it will sit down, in [m] (an assumption).
        depth: Of the seat in [m].
        rounding: Way behind an edge over which it comes to bear, in [m] (an assumption).
        stiffness: Of the seated body in [N] / [m]: 5 Hz with 45 kg sprung, the mean of 60 people (Fairley
            and Griffin 1989, J Biomech 22:81).
        dissipation: In [s] / [m]; under 550 N this is their damping of 0.475 of critical, 1340 N s/m.
        thigh_share: Share of the stiffness that the backs of the two thighs have (an assumption).
        hip_height: Of the hips over the uncompressed seat in [m]; 0.098 in the manikin of SAE J826.
        thigh_thickness: From the axis of a thigh to its back where it meets the seat, in [m]: half of what
            sitting men measure (0.16 to the top of the thigh, 0.135 to 0.185 from the 5th to the 95th
            percentile).
        thigh_place: Where that is, from hip to knee (an assumption).
        friction_coefficient: Coulomb coefficient (an assumption; models of sitting have 0.6 to 0.9).
        transition_velocity: Of the regularised friction in [m] / [s] (an assumption).
    """

    height: Annotated[quantities.Length, quantities.Range(0.3, 0.7)] = 0.45
    front: quantities.Length = 0.25
    behind: quantities.Length = 0.1
    depth: Annotated[quantities.Length, quantities.POSITIVE] = 0.4
    rounding: Annotated[quantities.Length, quantities.POSITIVE] = 0.03
    stiffness: Annotated[quantities.LinearStiffness, quantities.POSITIVE] = 44.0e3
    dissipation: Annotated[quantities.LinearDissipation, quantities.NOT_NEGATIVE] = 2.4
    thigh_share: Annotated[quantities.Ratio, quantities.SHARE] = 0.3
    hip_height: Annotated[quantities.Length, quantities.POSITIVE] = 0.1
    thigh_thickness: Annotated[quantities.Length, quantities.NOT_NEGATIVE] = 0.08
    thigh_place: Annotated[quantities.Ratio, quantities.SHARE] = 0.5
    friction_coefficient: Annotated[quantities.Ratio, quantities.NOT_NEGATIVE] = 0.7
    transition_velocity: Annotated[quantities.Speed, quantities.POSITIVE] = 0.02
