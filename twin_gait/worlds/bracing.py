"""The wearer bound to the device by braces instead of rigidly."""

from dataclasses import replace

import numpy as np

from twin_gait.core.plant import Brace, free_coordinate
from twin_gait.leg_model import LegModel
from twin_gait.parameters import BraceParameters, SlidingSpringDamper, SpringDamper
from twin_gait.worlds.world import Braces, World


def brace_world(world: World, device: LegModel, wearer: LegModel, parameters: BraceParameters) -> World:
    """Take device and wearer of a world apart and bind them by braces.

    Motors, friction, stops, orthosis and imposed motion stay with the device; the support and the feet go
    with the wearer. Both start in the posture of the world.
    """
    of_wearer, of_device = [free_coordinate() for _ in world.plant], list(world.plant)
    for pelvis in (world.model.pelvis_index, world.model.forward_index):
        if pelvis is not None:
            of_device[pelvis], of_wearer[pelvis] = of_wearer[pelvis], of_device[pelvis]
    return replace(
        world,
        plant=(*of_device, *of_wearer),
        start_q=np.tile(world.start_q, 2),
        start_v=np.tile(world.start_v, 2),
        braces=Braces(device=device, wearer=wearer, braces=_braces(world.model, parameters)),
    )


def _braces(model: LegModel, parameters: BraceParameters) -> tuple[Brace, ...]:
    laws: dict[int, SpringDamper | SlidingSpringDamper] = dict.fromkeys(
        range(model.nv), parameters.pelvis
    )  # the pelvis is what is no joint
    for side, leg in model.legs.items():
        laws |= {model.index(side, joint): parameters.of(joint) for joint, _ in leg.items()}
    return tuple(Brace(laws[index].stiffness, laws[index].damping) for index in range(model.nv))
