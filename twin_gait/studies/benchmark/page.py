"""The page of documentation on speed, from the folder of a ``twin-gait benchmark --out``.

``python -m twin_gait.studies.benchmark.page FOLDER docs`` writes ``benchmark.md`` and ``benchmark.png``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from twin_gait.files import write_atomically
from twin_gait.report.benchmark import draw_benchmark_figure
from twin_gait.report.canvas import picture_bytes
from twin_gait.studies.benchmark.ratios import Verdict, judge
from twin_gait.studies.benchmark.table import DOCUMENT, PICTURE, draw_benchmark

PAGE = "benchmark.md"

PAGE_TEXT = """# How fast it is

`twin-gait benchmark` times the compiled engine, the Pinocchio engine, a plain script on Pinocchio and
MuJoCo in one process and in turn, {rounds} rounds of each, with the same integrator and step. Nanoseconds
are those of one machine; what carries over are the ratios. "Bare" is MuJoCo's `mj_step` alone in one C
call, without any controller: the loop that it is compared with senses, watches, controls, drives the motors
and rubs besides.

![Time per tick, accuracy beside speed, and how the cost grows](benchmark.png)

## The ratios it is held to

| world | step | what | measured | asked for | |
| --- | --- | --- | --- | --- | --- |
{verdicts}

{missed}

## All figures

```text
{figures}
```

Made by `twin-gait benchmark --out FOLDER` and `python -m twin_gait.studies.benchmark.page FOLDER docs`.
"""

IN_THE_WAY = """### What is in the way of those that are missed

Samples of the processor (`perf record`, 2026-11-21) put these shares of the loop's time into the C library:

| world | step | sine and cosine | exponential |
| --- | --- | --- | --- |
| bench_leg | Euler 1 ms | 20 % | 11 % |
| bench_leg | RK4 1 ms | 23 % | 18 % |
| contact_free_biped | Euler 1 ms | 19 % | 8 % |

One `sincos` for each joint and evaluation, and two exponentials of the friction law for each motor, in the
plant and once more in the compensator. The rest is one stretch of machine code: rigid bodies, state
machine, sensors, drives. MuJoCo's bare step has neither friction law nor controller nor sensors, so that
with Euler, one evaluation a tick, all of that weighs most; with Runge-Kutta, four evaluations, and with
contacts the ratio grows. Functions of our own for sine and exponential would save these shares at the very
best, and the C library's are kept. What would go further is a batch in lockstep, several episodes in one
vector register; the batch here runs whole episodes side by side on threads, which makes it {least:.1f} to
{most:.1f} times as fast as one episode without its log."""


def page_text(document: Mapping[str, Any]) -> str:
    """The page.

    Args:
        document: What a benchmark wrote.

    Returns:
        Markdown.
    """
    verdicts = judge(document)
    missed = [verdict for verdict in verdicts if not verdict.passed]
    gains = [_gain_of_threads(case) for case in document["cases"]]
    in_the_way = IN_THE_WAY.format(least=min(gains), most=max(gains))
    return PAGE_TEXT.format(
        rounds=document["rounds"],
        verdicts="\n".join(_row(verdict) for verdict in verdicts),
        missed=f"{len(missed)} of {len(verdicts)} are missed.\n\n{in_the_way}" if missed else "All are met.",
        figures=draw_benchmark(document),
    )


def _gain_of_threads(case: Mapping[str, Any]) -> float:
    times = {row["contestant"]: float(row["ns_per_tick"]) for row in case["rows"]}
    return times["compiled"] / times["batch"]


def _row(verdict: Verdict) -> str:
    sign = "at least" if verdict.unit == "x" else "below"
    unit = "×" if verdict.unit == "x" else f" {verdict.unit}"
    figure = "not timed" if verdict.figure is None else f"{verdict.figure:.3g}{unit}"
    met = "met" if verdict.passed else "**missed**"
    cells = (verdict.subject, verdict.stepping, verdict.what, figure, f"{sign} {verdict.bound:g}{unit}", met)
    return f"| {' | '.join(cells)} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write page and picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("measured", type=Path, help="folder that twin-gait benchmark --out has written")
    parser.add_argument("folder", type=Path, help="where the page goes")
    given = parser.parse_args(arguments)
    document = json.loads((given.measured / DOCUMENT).read_text(encoding="utf-8"))
    write_atomically(given.folder / PAGE, page_text(document))
    write_atomically(given.folder / PICTURE, picture_bytes(draw_benchmark_figure(document)))


if __name__ == "__main__":
    main()
