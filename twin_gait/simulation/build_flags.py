"""Build flags: constants that a loop is bound to; code that they exclude is not compiled.

The steps import these names; :mod:`twin_gait.simulation.binding` replaces them by those of a setup. Every
combination of flags is compiled, so a feature that costs less than 1 % of a tick where it is off is no flag
but a field of the record, such as ``has_wearer_torques``.
"""

from typing import TypeAlias

from twin_gait.core import friction
from twin_gait.experiment.experiment import IntegrationMethod
from twin_gait.parameters.network import ImpedanceLocation
from twin_gait.simulation.simulation_setup import SimulationSetup

# Flags in addition to those of the gait controller (twin_gait.control.gait_controller).
N_POINTS_PER_FOOT = 0  # Contact points of a foot.
N_CRUTCHES = 0  # Crutches.
PELVIS_INDEX = -1  # Index of the height of the pelvis, -1 if it is fixed.
FORWARD_INDEX = -1  # Index of the fore-aft motion of the pelvis, -1 if it is fixed.
PITCH_INDEX = -1  # Index of the pitch of the trunk, -1 if it is fixed.
WEARER_OFFSET = 0  # Index of a coordinate of the wearer less that of the device; 0 without braces.
FRICTION_INDICES: tuple[int, ...] = ()  # Coordinates with friction by equation (3.1).
GEAR_INDICES: tuple[int, ...] = ()  # Coordinates with friction by any law; their gears may lose torque.
WITH_ANKLES = False  # Legs have ankles.
WITH_OWN_GAIT = False  # The wearer moves joints without a drive.
WITH_RK4 = False  # The integration is a Runge-Kutta method.
WITH_SEAT = False  # There is a seat.
WITH_SLOPE = False  # The ground has a slope.
WITH_FAULTS = True  # There may be faults; False for a block of episodes without faults.
WITH_DELAY = False  # Commands are delayed.
WITH_NETWORK = False  # Boards and gait controller communicate over a bus.
WITH_CENTRAL_IMPEDANCE = False  # The gait controller computes the springs.

# All build flags of this module, which conditions of a schedule may contain.
FLAGS = {name: value for name, value in globals().items() if name.isupper()}

BuildFlags: TypeAlias = dict[str, int | tuple[int, ...]]


def compute_build_flags(setup: SimulationSetup, n_points: int) -> BuildFlags:
    """Return the build flags of a simulation setup; ``n_points``: number of contact points of all feet."""
    experiment, model, control = setup.experiment, setup.world.model, setup.experiment.control
    laws = [plant.friction.law for plant in setup.world.plant]
    return {
        "N_LEGS": len(setup.sides),
        "N_JOINTS_PER_LEG": setup.joints_per_leg,
        "N_POINTS_PER_FOOT": n_points // len(model.sides),
        "PELVIS_INDEX": -1 if model.pelvis_index is None else model.pelvis_index,
        "FORWARD_INDEX": -1 if model.forward_index is None else model.forward_index,
        "PITCH_INDEX": -1 if model.pitch_index is None else model.pitch_index,
        "N_CRUTCHES": len(setup.world.arms),
        "WITH_SEAT": setup.world.seat is not None,
        "WEARER_OFFSET": setup.world.wearer_offset,
        "WITH_ANKLES": all(leg.ankle is not None for leg in model.legs.values()),
        "WITH_OTHER_FRICTION_LAWS": any(law > friction.ROTATIONAL for law in laws),
        "FRICTION_INDICES": tuple(i for i, law in enumerate(laws) if law == friction.ROTATIONAL),
        "GEAR_INDICES": tuple(i for i, law in enumerate(laws) if law != friction.FRICTIONLESS),
        "WITH_OWN_GAIT": experiment.own_gait is not None,
        "WITH_RK4": experiment.resolved_integration.method is IntegrationMethod.RK4,
        "WITH_FAULTS": True,
        "WITH_SUPERVISOR": experiment.modes is not None,
        "WITH_INERTIA_COMPENSATION": control.inertia_compensation > 0.0,
        **setup.controller.build_flags(),
        "WITH_DELAY": control.delay_ticks > 0,
        "WITH_SLOPE": setup.world.slope != 0.0,
        "WITH_NETWORK": experiment.network is not None,
        "WITH_CENTRAL_IMPEDANCE": experiment.network is not None
        and experiment.network.impedance is ImpedanceLocation.CCU,
    }
