"""Setting of a descent after the loss of the supply."""

BENT = "{hip_deg: 20, knee_deg: 30}"
# A trunk that is guided without support, over bent knees on a belt at rest; for ``treadmill_start_stop``.
TRUNK_HELD = (
    "scenario.support={share: 0, lock_stiffness_N_per_m: 0}",
    "scenario.belt={start_s: 30, stop_s: 40}",
    f"scenario.leading_start={BENT}",
    f"scenario.trailing_start={BENT}",
    "table.phases.stand.hip.equilibrium_deg=20",
    "table.phases.stand.knee.equilibrium_deg=30",
)
