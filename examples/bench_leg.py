"""Bench leg: torque that moves the knee along a path, with increasing friction compensation. Seconds.

The leg hangs on a stand in transparent mode (no impedance, and gravity switched off so that only friction
acts), and the knee follows an imposed cosine path. The true friction is half of the compensator's model
(s = 0.5). Therefore the torque falls with the gain G, and for G > s the joint would keep moving by itself.
"""

# %%
import numpy as np
from gallery import form_of

from twin_gait import GaitPhase, load_experiment, simulate

form = form_of("bench_leg")


def settings(gain: float) -> list[str]:
    """Return the settings of one measurement."""
    gains = [f"table.phases.{phase}.knee.friction_compensation_gain={gain}" for phase in GaitPhase]
    return [
        "duration_s=8",
        "control.mode=transparent",
        "plant.gravity_m_per_s2=0",
        "scenario.start={hip_deg: 20, knee_deg: 20}",
        "scenario.imposed_motion={joint: knee, amplitude_deg: 40, frequency_Hz: 0.25}",
        *gains,
    ]


# %% [markdown]
# Torque and work in one period of the steady motion.

# %%
rows = []
for gain in (0.0, 0.2, 0.4):
    log = simulate(load_experiment("bench_leg", settings(gain)).experiment).log
    period = log[log["time_s"] >= 4.0]
    torque = period["right_knee_patient_torque_Nm"].to_numpy()
    power = torque * period["right_knee_velocity_rad_per_s"].to_numpy()
    row = {
        "G": gain,
        "torque_rms_Nm": float(np.sqrt((torque**2).mean())),
        "work_J": float(power.sum() * 1e-3),
    }
    print(row)
    rows.append(row)
form.keep({"rows": rows})

# %% [markdown]
# Homework: end the imposed motion (`scenario.imposed_motion.release_s=1`) at G = 0.4 and G = 0.7. What does
# the knee do?
