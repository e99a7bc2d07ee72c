"""Constants of :mod:`twin_gait.core.elementary` for 32-bit numbers, by the names of those that they replace."""

from __future__ import annotations

SINGLE: dict[str, float] = {
    "_SHIFT": 12582912.0,
    "_PER_LN2": 1.4426950216293335,
}
