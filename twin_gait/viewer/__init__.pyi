from . import animation as animation
from . import picture as picture
from . import server as server
