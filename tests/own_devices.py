"""Made-up devices: own motors, limits and names of the joints, and a gait table of four phases."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from twin_gait.files import shipped_file

# Names of the joints in the URDF of a made-up device; names may have blanks and minus signs.
NAMES: Mapping[str, str] = {
    "left_hip": "L-HipFE", "left_knee": "Knie links", "left_ankle": "joint_6",
    "right_hip": "R-HipFE", "right_knee": "Knie rechts", "right_ankle": "joint_3",
}  # fmt: skip
_DRIVES = {"hip": (0.1, 20.0), "knee": (0.08, 30.0), "ankle": (0.09, 25.0)}  # torque constant and gear ratio
FRICTION = {
    "breakaway_torque_Nm": 0.1,
    "coulomb_friction_Nm": 0.5,
    "breakaway_velocity_rad_per_s": 0.1,
    "viscous_friction_Nms_per_rad": 0.1,
}
# Equilibrium angles of hip, knee and ankle in degrees, by phase.
_PHASES = {"load": (5, 8, 0), "push": (-8, 10, 5), "swing_lift": (25, 45, -3), "swing_reach": (20, 6, 0)}


def drive(joint: str) -> dict[str, float]:
    """Return the drive of a joint."""
    constant, ratio = _DRIVES[joint]
    return {
        "torque_constant_Nm_per_A": constant,
        "resistance_Ohm": 0.2,
        "rotor_inertia_kgm2": 6e-5,
        "gear_ratio": ratio,
        "gear_inertia_kgm2": 1e-5,
        "gear_efficiency": 1.0,
        "continuous_torque_Nm": 15.0,
        "inductance_H": 1e-4,
    }


def write_urdf(path: Path, source: str) -> Path:
    """Write a shipped URDF with other names of its joints."""
    original = shipped_file(source)
    assert original is not None
    text = original.read_text(encoding="utf-8")
    for known, name in NAMES.items():
        text = re.sub(f'<joint name="{known}"', f'<joint name="{name}"', text)
    path.write_text(
        text.replace('filename="meshes/', f'filename="{original.parent}/meshes/'), encoding="utf-8"
    )
    return path


def leg(side: str, *, ankle: bool) -> dict[str, Any]:
    """Return the joints of a leg by their names in the URDF; with an ankle also its contact frames."""
    names = {joint: NAMES[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle")[: 3 if ankle else 2]}
    return {**names, "contact_frames": [f"{side}_heel", f"{side}_toe"]} if ankle else names


def write_device(folder: Path, joints: Sequence[str], **limits: float) -> Path:
    """Write a device of one leg with drives at some joints, and return its path."""
    ankle = "ankle" in joints
    urdf = write_urdf(folder / "links.urdf", "twin_ankle.urdf" if ankle else "twin_leg.urdf")
    content = {
        "schema_version": 2,
        "extends": "ideal",
        "description": "Made up for the tests.",
        "leg": {"urdf": urdf.name, "right": leg("right", ankle=ankle)},
        "plant": {
            "actuators": {joint: drive(joint) for joint in joints},
            "friction": dict.fromkeys(joints, FRICTION),
            "friction_ratio": dict.fromkeys(joints, 1.0),
        },
        "control": {
            "friction_model": dict.fromkeys(joints, FRICTION),
            "limits": {"torque_Nm": 40.0, "current_A": 30.0, **limits},
        },
    }
    path = folder / "device.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def write_table(folder: Path, joints: Sequence[str]) -> Path:
    """Write a gait table of four phases; the first joint opens its guards."""
    phases, transitions, order = dict[str, Any](), list[dict[str, Any]](), list(_PHASES)
    numbers = dict(zip(("hip", "knee", "ankle"), range(3), strict=True))
    for index, (phase, angles) in enumerate(_PHASES.items()):
        phases[phase] = {"gravity_compensation": 1.0}
        for joint in joints:
            phases[phase][joint] = {
                "stiffness_Nm_per_rad": 60 if joint == "hip" else 15,
                "damping_ratio": 0.7,
                "equilibrium_deg": angles[numbers[joint]],
                "friction_compensation_gain": 0.3,
            }
        here, before = (_PHASES[order[k]][numbers[joints[0]]] for k in (index, index - 1))
        guard = f"> {here - 2}" if here > before else f"< {here + 2}"
        step = {"from": phase, "to": order[(index + 1) % 4]}
        transitions.append({**step, "cause": "arrived", "all": [f"{joints[0]}.angle_deg {guard}"]})
        transitions.append({**step, "cause": "timeout", "after_s": 0.4})
    content = {
        "schema_version": 2,
        "name": "four_phases",
        "joints": list(joints),
        "blending": {"law": "minimum_jerk", "duration_ms": 60},
        "phases": phases,
        "transitions": transitions,
    }
    path = folder / "table.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def write_experiment(folder: Path, joints: Sequence[str], **limits: float) -> Path:
    """Write an experiment with a made-up device of one leg on the stand, and return its path."""
    content = {
        "schema_version": 2,
        "name": "made_up",
        "scenario": {"kind": "bench_leg", "start": {"hip_deg": 5, "knee_deg": 8}},
        "device": write_device(folder, joints, **limits).name,
        "table": write_table(folder, joints).name,
        "patient": None,
        "duration_s": 3,
    }
    path = folder / "made_up.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path
