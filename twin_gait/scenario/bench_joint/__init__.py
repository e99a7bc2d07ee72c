"""The joint test bench: one motor, one gear, a rigid link with a weight, a stop (thesis, section 2.2.1).

Sources: *thesis* is what it prints; *data sheet* is maxon's EC 90 flat 323772 (24 V); *from memory* was not
found again; *assumption* has no source, with the reason beside it.
"""

from twin_gait.scenario.bench_joint.bench import (
    BENCH_ACTUATORS,
    BENCH_FRICTION,
    BENCH_INDUCTANCE,
    BenchJoint,
    bench_joint,
)
from twin_gait.scenario.bench_joint.control import (
    LOWEST_VELOCITIES,
    TRANSPARENCY_STEPS,
    CompensationVelocity,
    CosinePath,
    DutyControl,
    OldFrictionModel,
    TorqueControl,
)
from twin_gait.scenario.bench_joint.drive import CatalogueEfficiency, CurrentLoop, DriveParameters, Torsion
from twin_gait.scenario.bench_joint.link import (
    HORIZONTAL,
    INERTIAL_NOISE,
    LOWER_STOP,
    STOP_ANGLE,
    BenchFriction,
    InertialSensor,
    InertialUnit,
    LinkParameters,
    LoadAngle,
)

__all__ = [
    "BENCH_ACTUATORS",
    "BENCH_FRICTION",
    "BENCH_INDUCTANCE",
    "HORIZONTAL",
    "INERTIAL_NOISE",
    "LOWER_STOP",
    "LOWEST_VELOCITIES",
    "STOP_ANGLE",
    "TRANSPARENCY_STEPS",
    "BenchFriction",
    "BenchJoint",
    "CatalogueEfficiency",
    "CompensationVelocity",
    "CosinePath",
    "CurrentLoop",
    "DriveParameters",
    "DutyControl",
    "InertialSensor",
    "InertialUnit",
    "LinkParameters",
    "LoadAngle",
    "OldFrictionModel",
    "TorqueControl",
    "Torsion",
    "bench_joint",
]
