"""Pages that need no server and no network: a recorded run, and any URDF with a slider for every joint."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import pandas as pd
import pinocchio as pin

from twin_gait.files import dump
from twin_gait.gait.table import TICK
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf import build_model, find_urdf
from twin_gait.leg_model.urdf_document import Mimic, mimic_joints
from twin_gait.measures.leg_record import leg_record
from twin_gait.viewer import environment
from twin_gait.viewer.commands import CommandBuffer, Track, set_animation
from twin_gait.viewer.figure import ArticulatedFigure
from twin_gait.viewer.motion import Motion, PhaseSpells, has_muscles, held_rows, read_motion
from twin_gait.viewer.page import PageTexts, encode_compressed, page_data, recorded_page
from twin_gait.viewer.scene import Scene, SceneOptions, build_scene, build_urdf_scene
from twin_gait.vocabulary import HOLD

_CONTINUOUS = ("position", "quaternion", "scale")
_SWITCH = 1e-4  # [s], time in which a colour changes or the belt marks jump back
_BELT_LOOK = 40  # number of ticks between two keys of the belt
_DECIMALS = 6  # decimals of positions in [m] and quaternions: 1 µm and 2 µrad
# A wider range is not a limit: it is a continuous joint, or a file that omits the limits.
_WIDEST_TURN, _WIDEST_WAY = 4.0 * math.pi, 10.0  # [rad], [m]
_FREE_TURN, _FREE_WAY = math.pi, 1.0  # [rad], [m], range in each direction of a joint without limits


def recorded_run(
    log: pd.DataFrame,
    model: LegModel,
    *,
    about: PageTexts,
    frames_per_second: float,
    frame_times: Sequence[float] = (),
    **setting: Unpack[SceneOptions],
) -> dict[str, Any]:
    """Return the data of one run for :func:`twin_gait.viewer.page.recorded_page`, which accepts one or two.

    The page runs from a file in any browser of 2023 or later; ``#t=3.2`` in its address opens it at that
    time. Each change of a phase has a frame, and each of ``frame_times`` in [s]. Raises ModelError if the
    URDF cannot be read, and ViewerError if the log does not match the model.
    """
    motion = read_motion(log, model, frames_per_second=frames_per_second, frame_times=frame_times)
    recorder = CommandBuffer()
    scene = build_scene(recorder, model, **setting)
    scene.draw_trails(motion)
    recorder.apply(scene.state_at(motion, 0))
    tracks = list(_tracks(scene, motion))
    if "belt_speed_m_per_s" in log and log["belt_speed_m_per_s"].any():
        tracks.append(_belt_track(log["belt_speed_m_per_s"].to_numpy()))
    recorder.send(set_animation(tracks, frames_per_second))
    return page_data(
        about,
        mode="recorded",
        view=scene.view,
        phases=motion.phase_names,
        shown={side: leg.curves for side, leg in motion.legs.items()},
        muscles=has_muscles(map(str, log)),
        duration=round(float(motion.times[-1]), 3),
        strides=_strides(log, model, motion),
        frames=encode_compressed(dump(_frames(motion)).encode("ascii")),
        scene=encode_compressed(recorder.packed()),
    )


def _strides(log: pd.DataFrame, model: LegModel, motion: Motion) -> dict[str, Any] | None:
    """Return the leg whose strides synchronise two runs, and their starts in [s]; None without strides."""
    side = model.sides[0]
    names = [name for name in motion.phase_names if name != HOLD]
    events = leg_record(log, side, names, TICK).stride_events
    starts = events[~held_rows(log)[events]] * TICK
    return {"side": str(side), "starts": np.round(starts, 3).tolist()} if len(starts) > 1 else None


def _frames(motion: Motion) -> dict[str, Any]:
    """Return times in [ms], curves and phases in the form that the script of the page reads."""
    legs = []
    for leg in motion.legs.values():
        series = {}
        for name, curve in leg.curves.items():
            # Forces in [N] have two decimals; angles in [deg] and torques in [N·m] have four.
            rounded = np.round(curve.values, 2 if name in ("force", "crutch") else 4) + 0.0
            known = [value if np.isfinite(value) else None for value in rounded.tolist()]
            series[name] = {"steps": np.diff(_milliseconds(curve.times), prepend=0).tolist(), "values": known}
        legs.append({"series": series, "phases": _spells(leg.phases)})
    return {"times": _milliseconds(motion.times).tolist(), "legs": legs, "modes": _spells(motion.modes)}


def _spells(spells: PhaseSpells | None) -> dict[str, Any] | None:
    return spells and {"starts": np.round(spells.starts, 3).tolist(), "codes": spells.codes.tolist()}


def _milliseconds(times: np.ndarray) -> np.ndarray:
    return np.round(1000.0 * times).astype(int)


def _tracks(scene: Scene, motion: Motion) -> Iterator[Track]:
    """Yield a track for every property that changes; constant properties have none."""
    states = [scene.state_at(motion, frame) for frame in range(len(motion.times))]
    # Switches have slightly earlier keys, because a key that is rounded up would come after its own frame.
    early = np.maximum(motion.times - _SWITCH, 0.0)
    for path, name in states[0]:
        values = np.array([state[path, name] for state in states])
        if name in _CONTINUOUS:
            track = Track(path, name, motion.times, np.round(values.astype(float), _DECIMALS) + 0.0)
        elif name == "color":  # interpolated: a key just before each frame repeats the old colour
            times = np.column_stack((early, motion.times)).ravel()[1:]
            colours = np.round(np.repeat(values[:, :3], 2, axis=0)[:-1], 4)
            track = Track(f"{path}/<object>", "material.color", times, colours)
        else:
            track = Track(path, name, early, values)
        if (track.values != track.values[0]).any():
            yield _drop_redundant_keys(track)


def _drop_redundant_keys(track: Track) -> Track:
    """Drop the keys inside an interval without change, which interpolation restores exactly."""
    if len(track.times) < 2:  # track of the belt in a run of a few ticks
        return track
    same = (track.values[1:] == track.values[:-1]).reshape(len(track.times) - 1, -1).all(axis=1)
    kept = ~np.concatenate(([False], same[:-1] & same[1:], [False]))
    return replace(track, times=track.times[kept], values=track.values[kept])


def _belt_track(speed: np.ndarray) -> Track:
    """Make the track of marks that move back with the belt and jump forward by one spacing, unnoticeably.

    ``speed`` of the belt at every tick in [m/s].
    """
    offsets = environment.belt_offset(TICK * (np.cumsum(speed) - speed))
    before = np.flatnonzero(np.abs(np.diff(offsets)) > 0.5 * environment.BELT_MARK_SPACING)
    ticks = np.union1d(np.arange(0, len(speed), _BELT_LOOK), np.append(before, before + 1))
    times = TICK * (ticks + np.isin(ticks, before)) - _SWITCH * np.isin(ticks, before)
    values = np.outer(np.round(offsets[ticks], 5), [1.0, 0.0, 0.0])
    return _drop_redundant_keys(Track(environment.BELT, "position", times, values))


def urdf_page(path: str | Path, *, up_axis: str = "z") -> str:
    """Return a self-contained page that shows a URDF.

    Every joint is at zero, or at the limit that is nearest to zero. ``path``: the file, or the name of a
    packaged one; ``up_axis``: vertical axis of the URDF, ``"x"``, ``"y"`` or ``"z"``. Raises ModelError if
    the URDF cannot be read.
    """
    urdf = find_urdf(path)
    model = build_model(urdf)
    recorder = CommandBuffer()
    scene = build_urdf_scene(recorder, model, urdf, up_axis=up_axis)
    counted = f"{model.njoints - 1} joints, {model.nv} degrees of freedom"
    page = page_data(
        PageTexts(title=urdf.name, subtitle=[counted]), mode="model", view=scene.view,
        joints=list(joint_entries(scene.figure, mimic_joints(urdf))),
        scene=encode_compressed(recorder.packed()),
    )  # fmt: skip
    return recorded_page([page])


def joint_entries(figure: ArticulatedFigure, mimics: Mapping[str, Mimic]) -> Iterator[dict[str, Any]]:
    """Yield the data of a slider for each joint that turns about or slides along one axis.

    ``mimics``: couplings of joints that follow another joint. An entry has name, path in the scene,
    ``slides``, axis in the frame of the joint, position in [m] and quaternion (x, y, z, w) at zero, and range
    in [rad] or [m], which is ``free`` if the file has no limits; a joint that follows another one also has
    ``mimic``.
    """
    model, rest = figure.model, figure.posture(pin.neutral(figure.model))
    for joint, name in zip(model.joints[1:], list(model.names)[1:], strict=True):
        if joint.nq != 1:  # planar and floating joints
            continue
        slides = joint.shortname().startswith("JointModelP")
        limits = model.lowerPositionLimit, model.upperPositionLimit
        lower, upper = (float(limit[joint.idx_q]) for limit in limits)
        free = not 0.0 < upper - lower <= (_WIDEST_WAY if slides else _WIDEST_TURN)
        if free:
            upper = _FREE_WAY if slides else _FREE_TURN
            lower = -upper
        path = figure.paths[name]
        yield {
            "name": name, "path": path, "slides": slides, "axis": figure.axis(name).tolist(),
            "position": rest[path, "position"], "quaternion": rest[path, "quaternion"],
            "lower": lower, "upper": upper, "free": free,
            **({"mimic": mimics[name]._asdict()} if name in mimics else {}),
        }  # fmt: skip
