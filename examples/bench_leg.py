"""Bench leg: how much torque a hand needs to move the knee, with more and more friction compensation.

The leg hangs on a stand in transparent mode (no impedance, gravity switched off to leave friction alone).
A hand leads the knee along a cosine path. The true friction is half of the compensator's model (s = 0.5),
so the hand's torque falls with the gain G, and beyond G = s the joint would run on by itself.
"""

import numpy as np

from twin_gait import GaitPhase, load_experiment, simulate


def settings(gain: float) -> list[str]:
    """Settings of one measurement."""
    gains = [f"table.phases.{phase}.knee.friction_compensation_gain={gain}" for phase in GaitPhase]
    return [
        "duration_s=8",
        "control.mode=transparent",
        "plant.gravity_m_per_s2=0",
        "scenario.start={hip_deg: 20, knee_deg: 20}",
        "scenario.hand={joint: knee, amplitude_deg: 40, frequency_Hz: 0.25}",
        *gains,
    ]


def main() -> None:
    print("   G   hand torque, RMS   work of the hand in one period")
    for gain in (0.0, 0.2, 0.4):
        log = simulate(load_experiment("bench_leg", settings(gain)).experiment).log
        period = log[log["time_s"] >= 4.0]
        torque = period["right_knee_patient_torque_Nm"].to_numpy()
        power = torque * period["right_knee_velocity_rad_per_s"].to_numpy()
        print(f"{gain:4.1f}   {np.sqrt((torque**2).mean()):10.2f} N m   {power.sum() * 1e-3:10.2f} J")


if __name__ == "__main__":
    main()
    # Homework: let the hand go (scenario.hand.release_s=1) at G = 0.4 and G = 0.7. What does the knee do?
