"""Build flags: constants that a loop is bound to; code that they exclude is not compiled.

The steps import these names; :mod:`twin_gait.simulation.binding` replaces them by those of a setup.
"""

from typing import TypeAlias

from twin_gait.core import friction
from twin_gait.experiment.experiment import IntegrationMethod
from twin_gait.parameters.network import ImpedanceLocation
from twin_gait.simulation.simulation_setup import SimulationSetup

# Flags in addition to those of the gait controller (twin_gait.control.gait_controller): contact points of a
# foot; index of the height, the fore-aft motion and the pitch of the pelvis, -1 if it is fixed; difference
# between the index of a wearer's coordinate and the device's, 0 without braces; number of crutches; a seat.
N_POINTS_PER_FOOT, PELVIS_INDEX, FORWARD_INDEX, PITCH_INDEX, WEARER_OFFSET, N_CRUTCHES, WITH_SEAT = (
    0,
    -1,
    -1,
    -1,
    0,
    0,
    False,
)
# Coordinates with friction by equation (3.1).
FRICTION_INDICES: tuple[int, ...] = ()
# Whether legs have ankles, the integration is a Runge-Kutta method, the run has faults, the wearer has
# moments, commands are delayed, the ground has a slope, boards and gait controller communicate over a bus,
# the gait controller computes the springs, and an inertial unit estimates the pitch of the trunk.
WITH_ANKLES = WITH_RK4 = WITH_FAULTS = WITH_WEARER = WITH_DELAY = WITH_SLOPE = WITH_NETWORK = (
    WITH_CENTRAL_IMPEDANCE
) = WITH_INERTIAL_UNIT = False

# All build flags of this module, which conditions of a schedule may contain.
FLAGS = {name: value for name, value in globals().items() if name.isupper()}

BuildFlags: TypeAlias = dict[str, int | tuple[int, ...]]


def compute_build_flags(setup: SimulationSetup, n_points: int) -> BuildFlags:
    """Return the build flags of a simulation setup; ``n_points``: number of contact points of all feet."""
    experiment, model, control = setup.experiment, setup.world.model, setup.experiment.control
    legs = len(setup.sides)
    return {
        "N_LEGS": legs,
        "N_JOINTS_PER_LEG": setup.joints_per_leg,
        "N_POINTS_PER_FOOT": n_points // legs,
        "PELVIS_INDEX": -1 if model.pelvis_index is None else model.pelvis_index,
        "FORWARD_INDEX": -1 if model.forward_index is None else model.forward_index,
        "PITCH_INDEX": -1 if model.pitch_index is None else model.pitch_index,
        "N_CRUTCHES": len(setup.world.arms),
        "WITH_SEAT": setup.world.seat is not None,
        "WEARER_OFFSET": setup.world.wearer_offset,
        "WITH_ANKLES": all(leg.ankle is not None for leg in model.legs.values()),
        "WITH_OTHER_FRICTION_LAWS": any(
            plant.friction.law > friction.ROTATIONAL for plant in setup.world.plant
        ),
        "FRICTION_INDICES": tuple(
            place
            for place, plant in enumerate(setup.world.plant)
            if plant.friction.law == friction.ROTATIONAL
        ),
        "WITH_RK4": experiment.resolved_integration.method is IntegrationMethod.RK4,
        "WITH_FAULTS": bool(experiment.faults),
        "WITH_SUPERVISOR": experiment.modes is not None,
        "WITH_INERTIA_COMPENSATION": control.inertia_compensation > 0.0,
        "WITH_WEARER": bool(setup.limbs[0].moments),
        **setup.controller.build_flags(),
        "WITH_DELAY": control.delay_ticks > 0,
        "WITH_SLOPE": setup.world.slope != 0.0,
        "WITH_NETWORK": experiment.network is not None,
        "WITH_INERTIAL_UNIT": setup.inertial,
        "WITH_CENTRAL_IMPEDANCE": experiment.network is not None
        and experiment.network.impedance is ImpedanceLocation.CCU,
    }
