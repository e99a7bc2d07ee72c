"""A monitor of the CAN bus in twenty lines: it receives a live walk and commands a knee (thesis, 2.4)."""

# %%
import subprocess
import sys
import tempfile
from pathlib import Path

import can
import cantools
import numpy as np
from gallery import read_options
from matplotlib.figure import Figure

form = read_options("can_monitor")
GROUP = "239.74.163.2"
DRAWN, FREE = (2.0, 4.0) if form.quick else (4.0, 8.0)  # [s]

# %% [markdown]
# The walk runs in a separate program. In a second terminal the command would be
# `twin-gait live bench_leg --can udp_multicast:239.74.163.2`.

# %%
folder = tempfile.TemporaryDirectory(prefix="can_monitor_")
live = [sys.executable, "-m", "twin_gait", "live", "bench_leg", "--can", f"udp_multicast:{GROUP}"]
live += ["--out", f"{folder.name}/run", "--port", "0", "--no-browser", "--no-pictures", "--no-record"]
walk = subprocess.Popen(live, stdout=subprocess.DEVNULL)

# %% [markdown]
# From here on only the DBC file is part of this package. The numbers of a command are for one joint,
# its `control` is for all joints. For some seconds a spring of 60 N·m/rad pulls the knee to 0.8 rad; then
# the gait continues.

# %%
database = cantools.database.load_file(Path(__file__).parents[1] / "urdf" / "twin.dbc")
state, measurement, command = (
    database.get_message_by_name(name)
    for name in ("gait_state", "right_knee_measurement", "right_knee_command")
)
filters = [{"can_id": item.frame_id, "can_mask": 0x7FF} for item in (state, measurement)]
wanted = {"stiffness": 60.0, "damping": 10.0, "equilibrium": 0.8, "gain": 0.3, "torque": 0.0, "counter": 0}
now = 0.0
times, angles = [], []
with can.Bus(GROUP, "udp_multicast", hop_limit=0, can_filters=filters) as bus:
    while now < FREE + 2.0:
        frame = bus.recv(60.0)
        assert frame is not None, "no frame was received"
        decoded = database.decode_message(frame.arbitration_id, frame.data)
        if frame.arbitration_id == measurement.frame_id:
            times.append(now)
            angles.append(decoded["angle"])
        else:  # every 10 ms; repeating a command has no effect
            now = decoded["time"]
            control = "impedance_control" if DRAWN < now < FREE else "walk"
            data = command.encode({**wanted, "control": control})
            bus.send(can.Message(arbitration_id=command.frame_id, data=data, is_extended_id=False))
walk.terminate()
walk.wait()
folder.cleanup()

# %%
time, angle = np.array(times), np.array(angles)
rest = angle[(time > FREE - 0.2) & (time < FREE)]
print(f"{len(angles)} measurements; the knee is drawn to {rest.mean():.2f} rad")
figure = Figure(figsize=(7, 3), layout="constrained")
axes = figure.subplots()
axes.plot(time, np.degrees(angle))
axes.axvspan(DRAWN, FREE, alpha=0.15)
axes.set(xlabel="time [s]", ylabel="knee [°]", title="Knee on the bus; shaded: impedance control")
figure.savefig(form.out / "can_monitor.png", dpi=120)
form.write_results(
    {"measurements": len(angles), "duration_s": float(time[-1]), "knee_rad": float(rest.mean())}
)
