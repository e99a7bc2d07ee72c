"""Picture of a posture from the side, drawn without a browser."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from twin_gait.palette import SIDE_COLOURS
from twin_gait.simulation.simulation_setup import SimulationSetup
from twin_gait.vocabulary import Side

WIDTH, HEIGHT, RESOLUTION = 4.0, 4.8, 100  # [in], [in], dots per inch
PIXELS = round(HEIGHT * RESOLUTION), round(WIDTH * RESOLUTION)
TRUNK_LENGTH = 0.55  # [m], of the line that shows the trunk
LIMB: dict[str, Any] = {"linewidth": 9, "solid_capstyle": "round", "markersize": 6}
REACH = 1.0  # [m], of the drawing to both sides of the pelvis


def draw_posture(setup: SimulationSetup, q: np.ndarray) -> np.ndarray:
    """Draw the wearer's legs and trunk in the sagittal plane; the left leg is in front.

    ``q``: coordinates of an episode in [rad] and [m]. Returns an image of shape ``(480, 400, 3)``, 8 bits.
    """
    world = setup.world
    model, own = world.chains[-1], q[world.wearer_offset :]
    ahead, up = ["xyz".index("yxx"["xyz".index(model.up_axis)]), "xyz".index(model.up_axis)]

    def positions(names: Sequence[str]) -> np.ndarray:
        return np.array(model.frame_positions(own, names)).reshape(-1, 3)[:, [ahead, up]]

    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=RESOLUTION)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    hips = []
    for side in sorted(model.legs, key=lambda side: side is Side.LEFT):
        points = positions([name for _, name in model.legs[side].plain.items()])
        soles = positions(list(world.contact_frames.get(side, ())))
        hips.append(points[0])
        colour = SIDE_COLOURS[side]
        axes.plot(
            *np.array([*points, *soles[:1]]).T,
            color=colour,
            linewidth=9,
            solid_capstyle="round",
            marker="o",
            markersize=6,
        )
        if len(soles) > 1:
            axes.plot(*soles.T, color=colour, linewidth=9, solid_capstyle="round")
    hip = np.mean(hips, axis=0)
    pitch = 0.0 if model.pitch_index is None else own[model.pitch_index]
    top = hip + TRUNK_LENGTH * np.array([np.sin(pitch), np.cos(pitch)])
    axes.plot(*np.array([hip, top]).T, color="0.3", linewidth=14, solid_capstyle="round", zorder=1)
    axes.axhline(0.0, color="0.75", linewidth=2, zorder=0)
    axes.set(xlim=hip[0] + np.array([-REACH, REACH]), ylim=(-0.2, 2.2), aspect="equal")
    axes.axis("off")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="rgba")
    return np.frombuffer(buffer.getvalue(), np.uint8).reshape(*PIXELS, 4)[..., :3].copy()
