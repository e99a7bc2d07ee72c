"""Coverage: do the 95 % intervals of an identification hold the truth in 95 of 100 campaigns?

Campaigns on the simulated bench, each with a seed of its own: 45 motor-driven tests in both directions,
identified from their logs alone with the rotational law and compared with the law that the bench had. 200
campaigns of a joint take some ten minutes on one core.
"""

import argparse

from twin_gait.identification import Processing
from twin_gait.studies.campaign import Protocol
from twin_gait.studies.coverage import (
    CoverageStudy,
    coverage_table,
    measure_coverage,
    parameter_coverage,
    usual_warnings,
)
from twin_gait.vocabulary import JointName


def main(joint: str = "knee", campaigns: int = 20, workers: int = 1, drop: bool = False) -> None:
    study = CoverageStudy(
        joint=JointName(joint),
        protocol=Protocol.DROP if drop else Protocol.TWO_WAY,
        campaigns=campaigns,
        processings=(Processing.ZERO_PHASE, Processing.THESIS),
    )
    for processing, estimates in measure_coverage(study, workers).items():
        print(f"{joint}, {campaigns} campaigns ({study.protocol}), {processing}")
        print(coverage_table(parameter_coverage(study.joint, estimates)))
        for warning, share in usual_warnings(estimates).items():
            print(f"  warns in {100.0 * share:.0f} %: {warning}")
        print()


if __name__ == "__main__":  # worker processes import this file
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--joint", choices=["hip", "knee"], default="knee")
    parser.add_argument("--campaigns", type=int, default=20)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--drop", action="store_true", help="the thesis's one-way falls instead")
    main(**vars(parser.parse_args()))
    # Homework: the thesis only had falls (--drop). Which parameters would you still believe?
