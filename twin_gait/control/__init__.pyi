from .controller import Controller as Controller
from .controller import Plan as Plan
from .controllers.assistance import AssistanceParameters as AssistanceParameters
from .controllers.position import PathParameters as PathParameters
from .safety import SafetyState as SafetyState
from .safety import Trip as Trip
from .safety import TripCause as TripCause
