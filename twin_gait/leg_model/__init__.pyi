from .joints import FORWARD_JOINT as FORWARD_JOINT
from .joints import PELVIS_JOINT as PELVIS_JOINT
from .joints import Bodies as Bodies
from .joints import LegJoints as LegJoints
from .leg_model import LegModel as LegModel
from .urdf import packaged_urdf as packaged_urdf
from .wearer import DeviceSizes as DeviceSizes
from .wearer import device_sizes as device_sizes
