from .hanging_leg import friction_slope as friction_slope
from .hanging_leg import friction_torque as friction_torque
from .hanging_leg import linear_loops as linear_loops
from .linear_loop import LinearLoop as LinearLoop
from .linear_loop import leg_motion as leg_motion
from .linear_loop import spectral_radius as spectral_radius
from .linear_loop import transition_matrix as transition_matrix
from .stability import largest_stable as largest_stable
