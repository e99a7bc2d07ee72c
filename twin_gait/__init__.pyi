from .configuration.experiments import load_experiment as load_experiment
from .configuration.experiments import presets as presets
from .configuration.gait_table_file import load_gait_table as load_gait_table
from .exceptions import TwinGaitError as TwinGaitError
from .experiment.experiment import Experiment as Experiment
from .gait.machine import GaitStateMachine as GaitStateMachine
from .gait.table import GaitTable as GaitTable
from .leg_model.leg_model import LegModel as LegModel
from .parameters.wearer import Patient as Patient
from .report.figures import plot_run as plot_run
from .runs.record import load_run as load_run
from .runs.record import save_run as save_run
from .runs.stride_table import stride_table as stride_table
from .runs.summary import summarise_run as summarise_run
from .simulation.run import Run as Run
from .simulation.run import RunStatus as RunStatus
from .simulation.simulator import simulate as simulate
from .studies.batch import simulate_batch as simulate_batch
from .vocabulary import GaitPhase as GaitPhase
from .vocabulary import JointName as JointName
from .vocabulary import Sex as Sex
from .vocabulary import Side as Side

__version__: str
