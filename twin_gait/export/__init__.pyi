from .inverse_dynamics import export_inverse_dynamics as export_inverse_dynamics
from .motion import export_csv as export_csv
from .motion import export_motion as export_motion
