"""Build flags: constants that a loop is bound to; code that they exclude is not compiled.

The steps import these names; :mod:`twin_gait.simulation.binding` replaces them by those of a setup.
"""

from typing import TypeAlias

from twin_gait.core import friction
from twin_gait.experiment import IntegrationMethod
from twin_gait.parameters import ImpedancePlace
from twin_gait.simulation.problem import Problem

# Flags in addition to those of the gait controller (twin_gait.control.gait_controller): contact points of a
# foot; index of the height, the fore-aft motion and the pitch of the pelvis, -1 if it is fixed; difference
# between the index of a wearer's coordinate and the device's, 0 without braces; number of crutches; a seat.
POINTS_PER_FOOT, PELVIS, FORWARD, PITCH, SHIFT, CRUTCHES, SEATED = 0, -1, -1, -1, 0, 0, False
# Coordinates with friction by equation (3.1).
WITH_FRICTION: tuple[int, ...] = ()
# Whether legs have ankles, the integration is a Runge-Kutta method, the run has faults, the wearer has
# moments, commands are delayed, the ground has a slope, boards and gait controller communicate over a bus,
# the gait controller computes the springs, and an inertial unit estimates the pitch of the trunk.
ANKLES = RK4 = FAULTY = WEARER = DELAYED = SLOPED = NETWORKED = CENTRAL = INERTIAL = False

# All build flags of this module, which conditions of a schedule may contain.
FLAGS = {name: value for name, value in globals().items() if name.isupper()}

Structure: TypeAlias = dict[str, int | tuple[int, ...]]


def structure_of(problem: Problem, n_points: int) -> Structure:
    """Return the build flags of a simulation setup; ``n_points``: number of contact points of all feet."""
    experiment, model, control = problem.experiment, problem.world.model, problem.experiment.control
    legs = len(problem.sides)
    return {
        "LEGS": legs,
        "JOINTS_PER_LEG": problem.joints_per_leg,
        "POINTS_PER_FOOT": n_points // legs,
        "PELVIS": -1 if model.pelvis_index is None else model.pelvis_index,
        "FORWARD": -1 if model.forward_index is None else model.forward_index,
        "PITCH": -1 if model.pitch_index is None else model.pitch_index,
        "CRUTCHES": len(problem.world.arms),
        "SEATED": problem.world.seat is not None,
        "SHIFT": problem.world.wearer_shift,
        "ANKLES": all(leg.ankle is not None for leg in model.legs.values()),
        "OTHER_LAWS": any(plant.friction.law > friction.ROTATIONAL for plant in problem.world.plant),
        "WITH_FRICTION": tuple(
            place
            for place, plant in enumerate(problem.world.plant)
            if plant.friction.law == friction.ROTATIONAL
        ),
        "RK4": experiment.stepping.method is IntegrationMethod.RK4,
        "FAULTY": bool(experiment.faults),
        "SUPERVISED": experiment.modes is not None,
        "INERTIA_WANTED": control.inertia_compensation > 0.0,
        "WEARER": bool(problem.limbs[0].moments),
        **problem.controller.constants(),
        "DELAYED": control.delay_ticks > 0,
        "SLOPED": problem.world.slope != 0.0,
        "NETWORKED": experiment.network is not None,
        "INERTIAL": problem.inertial,
        "CENTRAL": experiment.network is not None and experiment.network.impedance is ImpedancePlace.CCU,
    }
