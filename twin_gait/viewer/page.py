"""Page of the viewer: a template with styles, scripts, meshcat's bundle and the data of runs."""

from __future__ import annotations

import base64
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from importlib.metadata import distribution
from pathlib import Path
from typing import TYPE_CHECKING, Any, Required, TypedDict

import numpy as np

from twin_gait import palette
from twin_gait.files import dump
from twin_gait.labels import label_of
from twin_gait.measures.outcome import RunEvent
from twin_gait.templates import make_template_environment
from twin_gait.viewer.arrows import FULL_TORQUE, METRES_PER_NEWTON
from twin_gait.viewer.commands import rgb
from twin_gait.viewer.environment import FLOOR
from twin_gait.vocabulary import Side

if TYPE_CHECKING:
    from twin_gait.viewer.scene import View

PAGE_FOLDER = Path(__file__).with_name("page")
FOOTNOTE = "Simulation, not a medical device"
_EFFORT = 6  # level of compression; 9 makes a page 1 % smaller and takes four times as long
_INKS = "#ffffff", "#1b2430"
_FORCE = f"Ground force (10 cm: {0.1 / METRES_PER_NEWTON:.0f} N)"
_ARROW = {"label": _FORCE, "colour": palette.GROUND_FORCE_COLOUR}
_EXTENSION = f"Extension torque (longest from {FULL_TORQUE:.0f} N·m on)"
# Column of the log, without the prefix of its object, by the kind of a curve.
_COLUMNS = {
    "angle": "angle_rad",
    "torque": "motor_torque_Nm",
    "force": "normal_force_N",
    "crutch": "crutch_normal_force_N",
}
_ARCS = (
    {"label": "Flexion torque", "colour": palette.FLEXION_COLOUR},
    {"label": _EXTENSION, "colour": palette.EXTENSION_COLOUR},
)


def viewer_folder() -> Path:
    """Return the folder of meshcat's viewer, without importing meshcat."""
    return Path(str(distribution("meshcat").locate_file("meshcat/viewer")))


class PageTexts(TypedDict, total=False):
    """Texts of a page about a run or a live scene.

    Attributes:
        title: Heading of the page.
        subtitle: Parts of the line below the heading.
        differing: Parts of the subtitle that the other run of a pair does not have.
        notes: Further sentences on the card.
        events: Events of the run, such as trips and falls.
        outcome: Outcome of the run in one word.
        walk: Table of the walk as texts: a header and rows.
        modes: Names of the operating modes in the order of their codes.
    """

    title: Required[str]
    subtitle: Sequence[str]
    differing: Sequence[str]
    notes: Sequence[str]
    events: Iterable[RunEvent]
    outcome: str
    walk: Sequence[Sequence[str]]
    modes: Sequence[str]


CurveNames = Mapping[Side, Iterable[str]]  # names of the curves of each leg


def page_data(
    texts: PageTexts,
    *,
    mode: str,
    view: View,
    phases: Sequence[str] = (),
    shown: CurveNames | None = None,
    muscles: bool = False,
    **mode_data: Any,
) -> dict[str, Any]:
    """Return the data of a run or of a live scene for the scripts of the page.

    ``mode``: ``recorded``, ``live`` or ``model``; ``muscles``: whether the torques of some joints are those
    of the wearer's muscles, not of motors; ``mode_data``: further data of this mode.
    """
    legs = [
        {"side": str(side), "label": str(side).capitalize(), "colour": palette.SIDE_COLOURS[side],
         "dark": palette.SIDE_COLOURS_ON_DARK[side], "shows": ["phase", *keys]}
        for side, keys in (shown or {}).items()
    ]  # fmt: skip
    columns = {**_COLUMNS, "torque": "torque_Nm"} if muscles else _COLUMNS
    return {
        **texts,
        "mode": mode,
        "title": _unicode(texts["title"]),
        "subtitle": list(map(_unicode, texts.get("subtitle", ()))),
        "differing": list(map(_unicode, texts.get("differing", ()))),
        "notes": list(map(_unicode, texts.get("notes", ()))),
        "view": asdict(view),
        "phases": _phase_entries(phases),
        "modes": [_words(name) for name in texts.get("modes", ())],
        "events": event_entries(texts.get("events", ())),
        "parts": [
            {"key": key, "label": label_of(key).name, "colour": colour}
            for key, colour in palette.TORQUE_COLOURS.items()
            if any(name.endswith(f"_{key}") for leg in legs for name in leg["shows"])
        ],
        "labels": {
            kind: {"name": label_of(column).name, "unit": label_of(column).display_unit}
            for kind, column in columns.items()
        },
        "legs": legs,
        "arrow": _ARROW if any("force" in leg["shows"] for leg in legs) else None,
        "arcs": _ARCS if legs else (),
        "floor": FLOOR,  # object that is darkened on a dark page
        "duration": None,  # in [s]; None if there is no end
        "footnote": FOOTNOTE,
        **mode_data,
    }


def event_entries(events: Iterable[RunEvent]) -> list[dict[str, Any]]:
    """Return the events of a run as a page reads them: kind, time in [s] and text."""
    return [{"kind": str(event.kind), "time": event.time, "text": event.text} for event in events]


def _unicode(text: str) -> str:
    # File names that are not UTF-8 contain lone surrogates in Python, which browsers cannot process.
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def _phase_entries(names: Sequence[str]) -> list[dict[str, str]]:
    shorts = ["".join(word[0] for word in name.split("_") if word)[:2].upper() for name in names]
    if "" in shorts or len(set(shorts)) < len(names):  # letters that two phases share would be ambiguous
        shorts = [str(number) for number in range(1, len(names) + 1)]
    entries = []
    for code, (name, short) in enumerate(zip(names, shorts, strict=True)):
        colour = palette.phase_colour(name, code)
        ink = max(_INKS, key=partial(_contrast, colour))
        entries.append({"name": name, "label": _words(name), "short": short, "colour": colour, "ink": ink})
    return entries


def _words(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _contrast(one: str, other: str) -> float:
    """Compute the contrast ratio of two colours as defined by WCAG 2."""
    shares = np.array([rgb(one), rgb(other)])
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    darker, lighter = sorted(linear @ [0.2126, 0.7152, 0.0722] + 0.05)
    return float(lighter / darker)


def recorded_page(runs: Sequence[Mapping[str, Any]]) -> str:
    """Return a self-contained page, which loads nothing from elsewhere.

    ``runs``: one run, or two to be shown next to each other: :func:`page_data` with ``frames`` and ``scene``,
    both compressed by :func:`encode_compressed`. A model, which is always shown alone, has a scene, and
    ``joints`` instead of frames.
    """
    folder = viewer_folder()
    licences = [folder / "LICENSE", folder / "dist" / "main.min.js.LICENSE.txt"]
    notice = "\n\n".join(path.read_text(encoding="utf-8") for path in licences if path.is_file())
    data = embedded_json({"mode": runs[0]["mode"], "runs": list(runs)})
    title, bundle = " | ".join(run["title"] for run in runs), encode_compressed(_bundle())
    return _filled(live=False, title=title, notice=notice.replace("--", "- -"), data=data, bundle=bundle)


def live_page() -> str:
    """Return the page of a live walk with its panel, whose script passes the data to ``window.twinGait``."""
    bundle = re.sub(r"<(?=/script|!--)", r"\\x3c", _bundle().decode(), flags=re.IGNORECASE)
    return _filled(live=True, title="twin_gait", data=embedded_json({"mode": "live"}), bundle=bundle)


def _bundle() -> bytes:
    """Read the script of meshcat's viewer."""
    return (viewer_folder() / "dist" / "main.min.js").read_bytes()


def _filled(**content: Any) -> str:
    template = make_template_environment(PAGE_FOLDER, autoescape=True).get_template("page.html")
    return template.render(palette=palette, **content)


def encode_compressed(content: bytes) -> str:
    """Compress bytes and encode them as text that can be part of a page."""
    return base64.b64encode(zlib.compress(content, _EFFORT)).decode("ascii")


def embedded_json(data: Mapping[str, Any]) -> str:
    """Return JSON that can be written inside a script element, because no text in it can end the element."""
    return dump(data).replace("<", "\\u003c")
