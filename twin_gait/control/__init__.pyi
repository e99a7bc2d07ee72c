from .controller import Controller as Controller
from .controller import ControllerFunction as ControllerFunction
from .controller import ControllerTorques as ControllerTorques
from .controller import JointMeasurement as JointMeasurement
from .controller import JointSetpoint as JointSetpoint
from .safety import SafetyState as SafetyState
from .safety import Trip as Trip
from .safety import TripCause as TripCause
