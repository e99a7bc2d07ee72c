"""Parts of the device ``twin_leg``, whose numbers the tests use."""

from twin_gait.configuration.bench_device import BENCH_ACTUATORS, BENCH_DEVICE, BENCH_FRICTION
from twin_gait.configuration.device_file import load_device

_PARAMETERS = load_device(BENCH_DEVICE).parameters()
PLANT, CONTROL, SENSORS = (_PARAMETERS[name] for name in ("plant", "control", "sensors"))
TWIN_SIZES = _PARAMETERS["leg"].sizes
HIP_ACTUATOR, KNEE_ACTUATOR = BENCH_ACTUATORS["hip"], BENCH_ACTUATORS["knee"]
HIP_FRICTION, KNEE_FRICTION = BENCH_FRICTION["hip"], BENCH_FRICTION["knee"]
GYROSCOPE_NOISE, ACCELEROMETER_NOISE = SENSORS.trunk.gyroscope_noise, SENSORS.trunk.accelerometer_noise
