"""How a loop in blocks of 10 ms keeps to the clock, how well it does, and who goes before others."""

import contextlib
import gc
import os
import sys
import threading

from twin_gait.gait.table import TICK
from twin_gait.live.protocol import DeadlineStatistics

BLOCK_TICKS = 10
PERIOD = BLOCK_TICKS * TICK  # [s]
LATE = PERIOD  # [s]; a block that is finished later than this after its time counts as late
CATCH_UP = 5 * PERIOD  # [s]; a loop further behind than this gives the time up instead of racing after it
SWITCH_INTERVAL = 1e-3  # [s], after which a thread must let another one go on
REAL_TIME_PRIORITY = 1  # the lowest real-time one is above all that is not real time


class BlockClock:
    """When the next block is to begin, and how late the blocks so far were finished.

    Block n of a stretch without a pause begins n periods after its start and is to be finished one period
    later. The caller asks the time; nothing here does.
    """

    def __init__(self) -> None:
        """Begin without any block."""
        self.statistics = DeadlineStatistics()  # of all blocks so far
        self._start: float | None = None
        self._number = 0

    def wait(self, now: float) -> float:
        """Time until the next block may begin.

        ``now``: present time in [s]. Returns time in [s]; 0 if the block is due. A loop that is more than
        ``CATCH_UP`` behind begins a new stretch; the time that it gives up is counted as lost, and the blocks
        that belonged there as late.
        """
        if self._start is None:
            self._start, self._number = now, 0
        behind = now - (self._start + self._number * PERIOD)
        if behind > CATCH_UP:
            self.statistics.lost_s += behind
            self._start, self._number = now, 0
            self._count(behind, round(behind / PERIOD))
            return 0.0
        return max(0.0, -behind)

    def finished(self, now: float) -> None:
        """Count a block. ``now``: time in [s] at which it was finished."""
        assert self._start is not None  # a block is waited for before it is finished
        self._number += 1
        self._count(max(0.0, now - (self._start + self._number * PERIOD)), 1)

    def _count(self, lateness: float, blocks: int) -> None:
        counted = self.statistics
        counted.blocks += blocks
        counted.late += blocks * (lateness > LATE)
        counted.worst_ms = max(counted.worst_ms, 1e3 * lateness)

    def pause(self) -> None:
        """Let the next block begin a new stretch: time until then is nobody's loss."""
        self._start = None


def go_before_others() -> None:
    """Keep garbage collection, other threads and other processes out of the way of this one."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.disable()
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # not for every user: see ulimit -r
            for thread in threading.enumerate():
                priority = os.sched_param(REAL_TIME_PRIORITY)
                os.sched_setscheduler(thread.native_id or 0, os.SCHED_RR, priority)
