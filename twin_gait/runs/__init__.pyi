from .record import load_run as load_run
from .record import save_run as save_run
from .summary import summarise as summarise
from .summary import versions as versions
