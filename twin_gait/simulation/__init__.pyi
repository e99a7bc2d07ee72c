from .bench_joint import LOG_COLUMNS as LOG_COLUMNS
from .bench_joint import BenchRun as BenchRun
from .bench_joint import BenchVariation as BenchVariation
from .bench_joint import simulate_bench as simulate_bench
from .run import Run as Run
from .run import RunStatus as RunStatus
from .simulator import simulate as simulate
