"""Keys of schema version 1 that have another name now: an old file gets one line with the new name."""

from collections.abc import Container

# Present names by former names, without units; a former name counts only where the present one is allowed.
RENAMED = {
    "allowance": "error_deadband",
    "behind": "standing_distance",
    "board_silence": "board_timeout",
    "catch_dissipation": "lock_dissipation",
    "catch_stiffness": "lock_stiffness",
    "ccu_silence": "ccu_timeout",
    "chair_push": "chair_axial_force",
    "chair_turn": "chair_shoulder_moment",
    "forgetting": "forgetting_factor",
    "least": "min_assistance",
    "least_voltage_share": "min_voltage_share",
    "phase_time_out": "phase_timeout",
    "push": "axial_force",
    "push_per_lean": "axial_force_per_lean",
    "push_per_rate": "axial_force_per_lean_rate",
    "thigh_place": "thigh_position",
    "turn": "shoulder_moment",
    "turning_damping": "transverse_damping",
    "turning_stiffness": "transverse_stiffness",
}


def present_name(key: str, allowed: Container[str]) -> str:
    """Return the present name of a former key, with its unit, if it is allowed; otherwise an empty text."""
    for former in sorted(RENAMED, key=len, reverse=True):
        if key == former or key.startswith(f"{former}_"):
            present = RENAMED[former] + key.removeprefix(former)
            if present in allowed:
                return present
    return ""
