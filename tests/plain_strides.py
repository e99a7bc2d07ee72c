"""Numbers of ``strides.csv`` from the columns of a log, by plain loops without ``twin_gait.measures``.

The definitions are those of docs/reference/strides.md. Only NumPy is used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

TICK = 1e-3  # [s]
DEG = 180.0 / math.pi
Log = dict[str, np.ndarray]


@dataclass
class Facts:
    """Facts about a run that its log does not contain."""

    joints: list[str]  # joints with a motor
    mass: float  # [kg] of the wearer; NaN without one
    armature: dict[str, float]  # [kg·m²] by joint
    references: dict[str, np.ndarray]  # angle in [rad] at 0, 1, … 100 % by joint
    phases: list[str]  # phases of the gait table in their order
    steady: tuple[float, float] = (0.0, math.inf)  # [s]
    changes: list[float] = field(default_factory=list)  # [s] times of changes of parameters
    carried_weight: float = math.nan  # [N]
    friction: float = math.nan  # coefficient of the ground
    transition: float = math.nan  # [m/s] of its regularisation


def loaded_ticks(force: np.ndarray) -> np.ndarray:
    state, found = False, []
    for value in force:
        state = value > 20.0 or (state and value >= 10.0)
        found.append(state)
    return np.array(found)


def contacts(loaded: np.ndarray, hip: np.ndarray) -> tuple[list[int], list[int]]:
    """Return heel strikes and toe-offs."""
    touches, start = [], None
    for tick, on in enumerate([*loaded, False]):
        if on and start is None:
            start = tick
        if not on and start is not None:
            touches.append([start, tick])
            start = None
    stances: list[list[list[int]]] = []
    for touch in touches:
        if stances:
            left = stances[-1][-1][1]
            air = hip[left : touch[0]]
            swung = touch[0] - left >= 250 and (air.max() - air[0]) * DEG >= 5.0
        if stances and not swung:
            stances[-1].append(touch)
        else:
            stances.append([touch])
    strikes, offs = [], []
    for stance in stances:
        first, last = stance[0][0], stance[-1][1]
        edge = first < 250 or last == len(loaded)
        if not edge and sum(end - begin for begin, end in stance) < 150:
            continue
        if first >= 250:
            strikes.append(first)
        if last < len(loaded):
            offs.append(last)
    return strikes, offs


def cycle(signal: np.ndarray, start: int, end: int) -> np.ndarray:
    return np.interp(start + np.arange(101) / 100 * (end - start), np.arange(len(signal)), signal)


def rms(values: np.ndarray) -> float:
    return math.sqrt(np.mean(np.square(values)))


def error_parts(angles: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    found, healthy = angles[:-1], reference[:-1]
    offset = np.mean(found - healthy)
    centred, wanted = found - found.mean(), healthy - healthy.mean()
    left = [np.mean((np.roll(centred, -shift) - wanted) ** 2) for shift in range(-49, 51)]
    best = int(np.argmin(left))
    whole, shape = np.mean((centred - wanted) ** 2), left[best]
    parts = {
        "total": math.sqrt(offset**2 + whole),
        "offset": offset,
        "timing": math.sqrt(max(whole - shape, 0)),
    }
    parts["shape"] = math.sqrt(shape)
    degrees = {f"error_{name}_deg": DEG * value for name, value in parts.items()}
    return {**degrees, "error_shift_percent": float(best - 49)}


def two_peaks(load: np.ndarray) -> list[float]:
    """Return loading peak, trough and push-off peak of a stride, NaN where there are no two peaks."""
    none, swing, run = [math.nan] * 3, [0, 100], 0
    longest = 0
    for percent in range(101):
        if percent < 100 and load[percent] < 0.05:
            run += 1
            if run > longest:
                longest, swing = run, [percent - run + 1, percent]
        else:
            run = 0
    stance = load[: swing[0]] if longest else load[:100]
    curve, peaks, length = np.array([0.0, *stance, 0.0]), list[int](), len(stance)
    for at in range(1, length + 1):
        if curve[at] > curve[at - 1] and curve[at] >= curve[at + 1]:
            sides = []
            for step in (-1, 1):
                low, index = curve[at], at
                while 0 <= index < len(curve) and curve[index] <= curve[at]:
                    low, index = min(low, curve[index]), index + step
                sides.append(low)
            if curve[at] - max(sides) >= 0.02:
                peaks.append(at - 1)
    halves = [p for p in peaks if p < length / 2], [p for p in peaks if p >= length / 2]
    if not all(halves):
        return none
    early, late = (max(half, key=lambda p: (stance[p], -p)) for half in halves)
    if any(0.45 <= p / length <= 0.55 for p in (early, late)):
        return none
    first, last = max(early, math.ceil(length / 3)), min(late, math.floor(2 * length / 3))
    low = first + int(np.argmin(stance[first : last + 1]))
    return none if low in (first, last) else [stance[early], stance[low], stance[late]]


def smooth_jerk(velocity: np.ndarray) -> np.ndarray:
    sigma = math.sqrt(math.log(2)) / (2 * math.pi * 50.0 * TICK)
    reach = math.ceil(4 * sigma)
    weights = np.array([math.exp(-0.5 * (k / sigma) ** 2) for k in range(-reach, reach + 1)])
    padded = np.concatenate([[velocity[0]] * reach, velocity, [velocity[-1]] * reach])
    smooth = sum(w * padded[k : k + len(velocity)] for k, w in enumerate(weights / weights.sum()))
    return np.array([0.0, *((smooth[2:] - 2 * smooth[1:-1] + smooth[:-2]) / TICK**2), 0.0])


def of_wearer(log: Log, joint: str, quantity: str) -> np.ndarray:
    return log.get(f"{joint}_wearer_{quantity}", log[f"{joint}_{quantity}"])


def joint_values(log: Log, leg: str, joint: str, facts: Facts, start: int, end: int) -> dict[str, float]:
    name, span, found = f"{leg}_{joint}", slice(start, end), dict[str, float]()
    angle, velocity = (of_wearer(log, name, item) for item in ("angle_rad", "velocity_rad_per_s"))
    whole = DEG * angle[start : end + 1]
    found |= {"lowest_deg": whole.min(), "peak_deg": whole.max(), "range_of_motion_deg": np.ptp(whole)}
    if joint in facts.references:
        found |= error_parts(cycle(angle, start, end), facts.references[joint])
    if joint not in facts.joints:
        return found
    torque, own = log[f"{name}_motor_torque_Nm"], log[f"{name}_velocity_rad_per_s"]
    device = torque + log[f"{name}_friction_torque_Nm"] - facts.armature[joint] * np.gradient(own, TICK)
    device = log.get(f"{name}_brace_torque_Nm", device)
    for who, acting in (("device", device), ("wearer", log[f"{name}_voluntary_torque_Nm"])):
        found[f"{who}_work_J"] = TICK * sum(max(0.0, power) for power in (acting * velocity)[span])
    power = torque * own
    found["torque_peak_Nm"] = np.abs(torque[start : end + 1]).max()
    found["torque_rms_Nm"] = rms(torque[span])
    found["current_rms_A"] = rms(log[f"{name}_measured_current_A"][span])
    found["power_peak_W"] = power[start : end + 1].max()
    found["positive_work_J_per_kg"] = TICK * sum(p for p in power[span] if p > 0) / facts.mass
    found["negative_work_J_per_kg"] = TICK * sum(p for p in power[span] if p < 0) / facts.mass
    measured, rest = log[f"{name}_measured_angle_rad"], log[f"{name}_equilibrium_rad"]
    stiffness = log[f"{name}_stiffness_Nm_per_rad"]
    found["tracking_error_peak_deg"] = DEG * np.abs(measured - rest)[start : end + 1].max()
    found["switch_energy_J"] = 0.0
    for k in range(max(start, 1), end):
        after, before = (0.5 * stiffness[n] * (measured[k] - rest[n]) ** 2 for n in (k, k - 1))
        found["switch_energy_J"] += after - before
    jerk, duration, peak = smooth_jerk(velocity), (end - start) * TICK, np.abs(velocity[span]).max()
    found["jerk_dimensionless"] = duration**3 / peak**2 * TICK * np.sum(jerk[span] ** 2)
    return found


def ground_values(
    log: Log,
    leg: str,
    facts: Facts,
    start: int,
    end: int,
    offs: list[int],
    other: tuple[np.ndarray, list[int]],
) -> dict[str, float]:
    force, push = log[f"{leg}_foot_normal_force_N"], log[f"{leg}_foot_friction_force_N"]
    span, time, loaded = slice(start, end), (end - start) * TICK, loaded_ticks(force)
    off = max(tick for tick in offs if tick < end)
    belt = np.mean(log["belt_speed_m_per_s"][span])
    speed = belt or (log["pelvis_forward_m"][end] - log["pelvis_forward_m"][start]) / time
    steps = [tick for tick in other[1] if start < tick < end]
    clearance = log[f"{leg}_foot_clearance_m"]
    quarter, rest = round(0.25 * (end - off)), round(0.75 * (end - off))
    slip = 0.0
    for tick in np.flatnonzero(loaded[span]) + start:
        ratio = abs(push[tick]) / (facts.friction * force[tick])
        slip += TICK * facts.transition * math.atanh(min(ratio, 1 - 1e-15))
    load, fore = (cycle(values, start, end) / facts.carried_weight for values in (force, push))
    loading, trough, push_off = two_peaks(load)
    return {
        "stance_time_s": (off - start) * TICK,
        "swing_time_s": (end - off) * TICK,
        "swing_share": (end - off) / (end - start),
        "double_support_share": np.mean(loaded[span] & other[0][span]),
        "speed_m_per_s": speed,
        "step_length_m": speed * (end - steps[-1]) * TICK if steps else math.nan,
        "load_peak": force[start : end + 1].max() / facts.carried_weight,
        "loading_peak": loading,
        "trough": trough,
        "push_off_peak": push_off,
        "braking_peak": min(fore.min(), 0.0),
        "propulsion_peak": max(fore.max(), 0.0),
        "load_impulse_Ns": TICK * sum(force[span]),
        "braking_impulse_Ns": TICK * sum(value for value in push[span] if value < 0),
        "propulsion_impulse_Ns": TICK * sum(value for value in push[span] if value > 0),
        "clearance_m": clearance[off + quarter : off + rest + 1].min(),
        "landing_speed_m_per_s": (clearance[start - 1] - clearance[start]) / TICK,
        "slip_m": slip,
    }


def onset(entered: list[tuple[int, int]], phase: int, start: int, end: int) -> float:
    """Return the onset in per cent; ``entered``: ticks and phases of all entries."""
    entries = [tick for tick, code in entered if code == phase]
    if phase == 0:
        entries = [k for k in entries if 2 * abs(k - start) < end - start]
        entries.sort(key=lambda k: abs(k - start))
    else:
        entries = [k for k in entries if start <= k < end]
    return 100 * (entries[0] - start) / (end - start) if entries else math.nan


def recompute(log: Log, facts: Facts) -> list[dict[str, Any]]:
    """Return the rows of the table of strides; the phases of a log are texts."""
    legs = [side for side in ("left", "right") if f"{side}_phase" in log]
    events, feet = {}, {}
    for leg in legs:
        codes = [facts.phases.index(name) for name in log[f"{leg}_phase"]]
        entered = [(k, code) for k, code in enumerate(codes) if k == 0 or codes[k - 1] != code]
        begins = [tick for tick, code in entered if code == 0]
        offs: list[int] = []
        if f"{leg}_foot_normal_force_N" in log:
            loaded = loaded_ticks(log[f"{leg}_foot_normal_force_N"])
            begins, offs = contacts(loaded, of_wearer(log, f"{leg}_hip", "angle_rad"))
            feet[leg] = loaded, begins
        first, last = (round(time / TICK) if time < math.inf else math.inf for time in facts.steady)
        pairs = [pair for pair in pairwise(begins) if pair[0] >= first and pair[1] <= last]
        events[leg] = entered, pairs, offs

    def changes_until(tick: int) -> int:
        return sum(round(time / TICK) <= tick for time in facts.changes)

    known = sorted({changes_until(pair[0]) for _, pairs, _ in events.values() for pair in pairs})
    rows = []
    for leg, (entered, pairs, offs) in events.items():
        in_condition = dict.fromkeys(known, 0)
        for number, (start, end) in enumerate(pairs, start=1):
            condition = changes_until(start)
            in_condition[condition] += 1
            row: dict[str, Any] = {"side": leg, "stride": number, "condition": 1 + known.index(condition)}
            row["settled"] = in_condition[condition] > 2 and changes_until(end - 1) == condition
            row |= {"start_s": start * TICK, "stride_time_s": (end - start) * TICK}
            row["cadence_per_min"] = 120.0 / row["stride_time_s"]
            for index, phase in enumerate(facts.phases):
                row[f"{phase}_onset_percent"] = onset(entered, index, start, end)
            if leg in feet:
                (other,) = (feet[side] for side in feet if side != leg)
                row |= ground_values(log, leg, facts, start, end, offs, other)
            for joint in ("hip", "knee", "ankle"):
                if f"{leg}_{joint}_angle_rad" in log:
                    values = joint_values(log, leg, joint, facts, start, end)
                    row |= {f"{joint}_{name}": value for name, value in values.items()}
            rows.append(row)
    return rows
