"""Cost of the CAN bus in the loop of the simulation: time of a tick with and without the bus, in turn.

The script takes a minute or two, mostly for compilation; the goal is at most a quarter more time.
"""

# %%
import statistics
import sys
import time
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "examples"))

from gallery import read_options

from twin_gait import Experiment, load_experiment
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup

MAX_TIME_RATIO = 1.25
BUSES = {
    "no bus": "ideal",
    "springs on the boards": "can",
    "springs on the CCU": "{impedance: ccu}",
    "with loss, errors, jitter and delay": "{loss: 0.1, error_share: 0.05, jitter_us: 200, delay_ms: 5}",
}


def walk(bus: str) -> Experiment:
    return load_experiment("treadmill_guided", [f"network={bus}", "duration_s=2"]).experiment


def time_of(problem: SimulationSetup, *, record: bool) -> float:
    """Return the processor time of a tick of the loop alone in [s]."""
    engine = CompiledEngine(problem)
    engine.episode["recording"]["on"] = record
    began = time.process_time()
    engine.run()
    return (time.process_time() - began) / problem.experiment.n_ticks


# %% [markdown]
# One round runs each problem once, so that other load on the machine affects all of them alike.

# %%
if __name__ == "__main__":
    form = read_options("network", Path(__file__).parent)
    problems = {name: build_setup(walk(bus)) for name, bus in BUSES.items()}
    rounds = 5 if form.quick else 200
    rows = []
    for record in (True, False):
        times: dict[str, list[float]] = {name: [] for name in problems}
        for _ in range(rounds):
            for name, problem in problems.items():
                times[name].append(time_of(problem, record=record))
        for name, found in times.items():
            ratios = [own / plain for own, plain in zip(found, times["no bus"], strict=True)]
            rows.append(
                {
                    "log": "kept" if record else "not kept",
                    "bus": name,
                    "least time of a tick [µs]": round(1e6 * min(found), 2),
                    "ratio of least times": round(min(found) / min(times["no bus"]), 3),
                    "median ratio of a round": round(statistics.median(ratios), 3),
                }
            )
            print(" | ".join(f"{key}: {value}" for key, value in rows[-1].items()))
    highest = max(row["ratio of least times"] for row in rows)
    form.write_results({"rounds": rounds, "rows": rows, "highest": highest, "most": MAX_TIME_RATIO})
    print(f"the bus makes the loop {highest:.2f} times as long at most; {MAX_TIME_RATIO:g} is allowed")
    sys.exit(int(not form.quick and highest > MAX_TIME_RATIO))
