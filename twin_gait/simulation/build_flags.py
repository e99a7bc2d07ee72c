"""What an episode's structure is: constants that a loop is bound to; what they rule out is not compiled.

The steps import these names; :mod:`twin_gait.simulation.binding` puts those of a problem in their place.
"""

from typing import TypeAlias

from twin_gait.core import friction
from twin_gait.experiment.experiment import IntegrationMethod
from twin_gait.parameters.network import ImpedanceLocation
from twin_gait.simulation.simulation_setup import SimulationSetup

# Beside what the gait controller is bound to (twin_gait.control.gait_controller): contact points of a foot;
# place of the pelvis' height, of its fore-aft motion and of its pitch, -1 without; how far behind a
# coordinate of the device that of the wearer stands, 0 if they are one; crutches; whether there is a seat.
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
# Whether legs have ankles, the integration is Runge-Kutta's, there are faults, the wearer acts, commands come
# late, the ground rises, boards and gait controller talk over a bus, the springs are in the gait controller,
# and an inertial unit finds the pitch of the trunk.
WITH_ANKLES = WITH_RK4 = WITH_FAULTS = WITH_WEARER = WITH_DELAY = WITH_SLOPE = WITH_NETWORK = (
    WITH_CENTRAL_IMPEDANCE
) = WITH_INERTIAL_UNIT = False

# All of these, which conditions of a schedule may name.
FLAGS = {name: value for name, value in globals().items() if name.isupper()}

BuildFlags: TypeAlias = dict[str, int | tuple[int, ...]]


def compute_build_flags(setup: SimulationSetup, n_points: int) -> BuildFlags:
    """Constants that a loop is bound to."""
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
