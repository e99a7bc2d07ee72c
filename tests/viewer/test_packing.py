"""Keys of tracks packed as a whole, and curves through rings: as umsgpack and SciPy would have them."""

from __future__ import annotations

import numpy as np
import pytest
import umsgpack
from scipy.interpolate import PchipInterpolator

from twin_gait.viewer.commands import Keys, Track, encode, set_animation
from twin_gait.viewer.shapes import monotone


def plain(value: object) -> object:
    """A command with keys as the mappings that they stand for."""
    if isinstance(value, Keys):
        pairs = zip(value.times.tolist(), value.values.tolist(), strict=True)
        return [{"time": time, "value": row} for time, row in pairs]
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("number", [1, 15, 16, 65_535, 65_536])
@pytest.mark.parametrize(("name", "width"), [("position", 3), ("quaternion", 4)])
def test_keys_have_the_bytes_of_umsgpack(number: int, name: str, width: int) -> None:
    draw = np.random.default_rng(number)
    times, values = np.cumsum(draw.uniform(size=number)), draw.normal(size=(number, width))
    values[-1] = [0.0, -0.0, 1e-45, -1e-3][:width]
    tracks = [
        Track("/a", name, times, values),
        Track("/b", "visible", times[:2], np.array([True, False][:2])),
    ]
    tracks = tracks if number > 1 else tracks[:1]
    command = set_animation(tracks, 30.0)
    assert encode(command) == umsgpack.packb(plain(command), force_float_precision="single")


@pytest.mark.parametrize("rings", [3, 4, 9])
def test_a_limb_is_as_smooth_as_scipy_has_it(rings: int) -> None:
    draw = np.random.default_rng(rings)
    for _ in range(100):
        values = draw.normal(size=(rings, 5)).round(1)  # equal neighbours occur
        places = np.linspace(0.0, rings - 1.0, 15)
        expected = PchipInterpolator(np.arange(rings), values)(places)
        np.testing.assert_allclose(monotone(values, places), expected, rtol=0.0, atol=1e-14)
