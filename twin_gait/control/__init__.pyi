from .controller import Controller as Controller
from .controller import ControllerFunction as ControllerFunction
from .safety import SafetyState as SafetyState
from .safety import Trip as Trip
from .safety import TripCause as TripCause
