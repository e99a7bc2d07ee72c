"""Table of strides of a recorded walk, with the columns of the table of a run, for ``twin-gait compare``."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from twin_gait.configuration.reference_file import resolve_reference
from twin_gait.gait.table import TICK
from twin_gait.measures import strides
from twin_gait.measures.phases import phase_entries, phase_onsets
from twin_gait.replay.foot_events import foot_strikes, walking_strides
from twin_gait.replay.machine import Replay
from twin_gait.replay.recording import is_normative, normative_curves
from twin_gait.vocabulary import JointName, Side

ReferenceAngles = Mapping[JointName, np.ndarray]  # angles at ``PERCENT`` in [rad], shape ``(101,)``


def read_reference(name: str) -> ReferenceAngles:
    """Read the curves with which the strides of a recorded walk are compared.

    ``name``: ``koopman@1.5`` (speed in km/h), ``winter``, or a file with strides in the format of LocoHub.
    Raises ParameterError or ParameterFileError if there is no such walk, or the file cannot be read.
    """
    if is_normative(name):
        curves = normative_curves(name)
        return {joint: curves.angle(joint, strides.PERCENT) for joint in curves.joints}
    found = resolve_reference(name, Path(), "--reference") or {}
    return {JointName(joint): np.array(curve) for joint, curve in found["mean_rad"].items()}


def replay_strides(result: Replay, reference: ReferenceAngles | None = None) -> pd.DataFrame:
    """Compute the table of strides from heel strike to heel strike.

    ``reference``: curves for the errors, see :func:`read_reference`; without them there are none. Returns one
    row for each stride of one leg after the other; all count as settled. Raises ParameterFileError if the
    heel strikes of a leg cannot be found.
    """
    tables = []
    for side in result.recording.sides:
        bounds = walking_strides(foot_strikes(result.recording, side)[0])
        identity = {
            "side": str(side),
            "stride": np.arange(1, len(bounds) + 1),
            "condition": 1,
            "settled": True,
            "start_s": result.recording.start + TICK * bounds[:, 0],
        }
        values = {**_timing(result, side, bounds), **_motion(result, side, bounds, reference or {})}
        tables.append(pd.DataFrame({**identity, **values}))
    return pd.concat(tables, ignore_index=True)


def _timing(result: Replay, side: Side, bounds: np.ndarray) -> dict[str, np.ndarray]:
    """Return durations [s], cadence, phase onsets [%] and, with recorded foot offs, stance and swing."""
    recording, times = result.recording, strides.stride_times(bounds, TICK)
    found = {"stride_time_s": times, "cadence_per_min": strides.cadences(times)}
    if side in recording.foot_offs:
        offs = np.rint((recording.foot_offs[side] - recording.start) / TICK).astype(int)
        swing = strides.swing_shares(bounds, offs)
        found |= {
            "stance_time_s": (1.0 - swing) * times,
            "swing_time_s": swing * times,
            "swing_share": swing,
        }
    for index, name in enumerate(result.table.phase_names):
        entries = phase_entries(result.phases[side], index)
        found[f"{name}_onset_percent"] = phase_onsets(entries[entries > 0], bounds, first=index == 0)
    return found


def _motion(
    result: Replay, side: Side, bounds: np.ndarray, reference: ReferenceAngles
) -> dict[str, np.ndarray]:
    """Return range and extremes of each recorded joint in [deg], and the parts of its errors."""
    found = dict[str, np.ndarray]()
    for joint in JointName:
        angle = result.recording.angles.get((side, joint))
        if angle is None:
            continue
        lowest, peak = np.degrees(strides.stride_extremes(angle, bounds)).T
        named = {"range_of_motion_deg": peak - lowest, "lowest_deg": lowest, "peak_deg": peak}
        if joint in reference:
            cycles = strides.normalise_strides(angle, bounds)
            parts = [strides.error_parts(cycle[None], reference[joint]) for cycle in cycles]
            named |= {
                f"error_{name}": np.array([one[name] for one in parts], dtype=float)
                for name in strides.ERROR_PARTS
            }
        found |= {f"{joint}_{name}": values for name, values in named.items()}
    return found


def angles_log(result: Replay) -> pd.DataFrame:
    """Return time and joint angles of a recorded walk as a log, from which curves are drawn."""
    recording = result.recording
    angles = {f"{side}_{joint}_angle_rad": angle for (side, joint), angle in recording.angles.items()}
    return pd.DataFrame({"time_s": recording.time, **angles})
