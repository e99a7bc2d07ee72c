"""Keeps what has to be in time from waiting for the rest of its process and of the machine."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import threading
from collections.abc import Iterator

SWITCH_INTERVAL = 1e-3  # [s], after which a thread must let another one go on
REAL_TIME_PRIORITY = 1  # the lowest real-time one is above all that is not real time


@contextlib.contextmanager
def undisturbed(*, alone: bool = False) -> Iterator[None]:
    """Keep garbage collection, other threads and other processes out of the way.

    ``alone``: whether it is this thread only that has to be in time. The others then go on as they do, and
    leave garbage that is collected; what there is at the start is left out of it.
    """
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.freeze()
    if not alone:
        gc.disable()
    _real_time(True, alone=alone)
    try:
        yield
    finally:
        _real_time(False, alone=alone)
        gc.enable()
        gc.unfreeze()
        sys.setswitchinterval(interval)


def _real_time(wanted: bool, *, alone: bool) -> None:
    """Let this thread, or all of this process, go before those of others, where the system allows it."""
    if sys.platform != "linux":
        return
    policy, priority = (os.SCHED_RR, REAL_TIME_PRIORITY) if wanted else (os.SCHED_OTHER, 0)
    threads = [threading.current_thread()] if alone else threading.enumerate()
    with contextlib.suppress(OSError):  # not for every user: see ulimit -r
        for thread in threads:
            os.sched_setscheduler(thread.native_id or 0, policy, os.sched_param(priority))
