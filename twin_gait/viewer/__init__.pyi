from .animation import write_animation as write_animation
from .session import LiveViewer as LiveViewer
from .session import show_run as show_run
from .session import view_urdf as view_urdf
