from .public import load_run as load_run
from .public import plot_run as plot_run
from .public import save_run as save_run
from .summary import summarise as summarise
from .summary import versions as versions
