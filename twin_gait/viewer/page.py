"""The page: hand-written HTML, style and script around meshcat's bundle and the data of a run."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.exceptions import ViewerError
from twin_gait.palette import REDDISH_PURPLE, SIDE_COLOURS, phase_colour
from twin_gait.vocabulary import Side

if TYPE_CHECKING:
    from twin_gait.viewer.scene import View

PAGE_FOLDER = Path(__file__).with_name("page")
FOOTNOTE = "Simulation, not a medical device"
FORCE_COLOUR = REDDISH_PURPLE
METRES_PER_NEWTON = 0.001  # length of the arrow of a ground force
# A recorded page may run what it holds and load nothing.
RECORDED_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)
LIVE_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; connect-src 'self' ws://127.0.0.1:* ws://localhost:*"
)


def viewer_folder() -> Path:
    """Folder of meshcat's viewer; finding it does not import meshcat.

    Raises:
        ViewerError: If meshcat is not installed.
    """
    spec = find_spec("meshcat")
    places = spec.submodule_search_locations if spec is not None else None
    folder = Path(next(iter(places))) / "viewer" if places else None
    if folder is None or not (folder / "dist" / "main.min.js").is_file():
        raise ViewerError("meshcat's viewer is not installed; pip install 'meshcat>=0.3.2'")
    return folder


def page_data(
    *,
    mode: str,
    title: str,
    subtitle: str,
    missing_meshes: Sequence[str],
    view: View,
    phases: Sequence[str],
    legs: Sequence[Mapping[str, Any]],
    arrows: bool,
    duration: float | None = None,
    **more: Any,
) -> dict[str, Any]:
    """Data that the script of the page reads.

    Args:
        mode: ``recorded`` or ``live``.
        title: Heading.
        subtitle: Line below it.
        missing_meshes: Mesh files that were not found.
        view: Where the camera is to look.
        phases: Names of the phases.
        legs: See :func:`leg_entry`.
        arrows: Whether ground forces are drawn.
        duration: In [s], or None if there is no end.
        more: Further entries.

    Returns:
        The data.
    """
    return {
        "mode": mode,
        "title": _unicode(title),
        "subtitle": _unicode(subtitle),
        "notes": _notes(missing_meshes),
        "view": asdict(view),
        "phases": [_phase_entry(name, code) for code, name in enumerate(phases)],
        "legs": list(legs),
        "arrow": {"label": _arrow_label(), "colour": FORCE_COLOUR} if arrows else None,
        "duration": duration,
        "footnote": FOOTNOTE,
        **more,
    }


def leg_entry(side: Side, shows: Sequence[str]) -> dict[str, Any]:
    """What a page needs to know of a leg.

    Args:
        side: Which leg.
        shows: What is known of it: ``phase`` and names of curves.

    Returns:
        Side, label, colour and what is shown.
    """
    label = str(side).capitalize()
    return {"side": str(side), "label": label, "colour": SIDE_COLOURS[side], "shows": list(shows)}


def _unicode(text: str) -> str:
    # File names that are not UTF-8 reach Python as lone surrogates, which browsers stumble over.
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def _phase_entry(name: str, code: int) -> dict[str, str]:
    colour = phase_colour(name, code)
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    bright = 0.299 * red + 0.587 * green + 0.114 * blue > 0.5
    label = name.replace("_", " ").capitalize()
    return {"name": name, "label": label, "colour": colour, "ink": "#1b2430" if bright else "#ffffff"}


def _arrow_label() -> str:
    return f"Ground force (10 cm: {0.1 / METRES_PER_NEWTON:.0f} N)"


def _notes(missing_meshes: Sequence[str]) -> list[str]:
    if not missing_meshes:
        return []
    first = Path(missing_meshes[0]).name
    more = f" and {len(missing_meshes) - 1} more" if len(missing_meshes) > 1 else ""
    return [f"Mesh not found: {first}{more}."]


def recorded_page(data: Mapping[str, Any], scene: str) -> str:
    """A page that holds everything it needs.

    Args:
        data: See :func:`page_data`.
        scene: Commands, compressed, as base64 text.

    Returns:
        HTML.
    """
    folder = viewer_folder()
    bundle = (folder / "dist" / "main.min.js").read_text(encoding="utf-8")
    licences = [folder / "LICENSE", folder / "dist" / "main.min.js.LICENSE.txt"]
    notice = "\n\n".join(path.read_text(encoding="utf-8") for path in licences if path.is_file())
    return _fill(
        policy=RECORDED_POLICY,
        title=html.escape(data["title"]),
        notice=f"<!-- The viewer in this page is meshcat:\n{notice.replace('--', '- -')}\n-->",
        data=embedded_json(data),
        scene=scene,
        bundle=f"<script>{_inside_script(bundle)}</script>",
    )


def live_page() -> str:
    """The page of the live viewer, which gets its data over a web socket.

    Returns:
        HTML.
    """
    return _fill(
        policy=LIVE_POLICY,
        title="twin_gait",
        notice="",
        data=embedded_json({"mode": "live"}),
        scene="",
        bundle='<script src="/static/main.min.js"></script>',
    )


def embedded_json(data: Mapping[str, Any]) -> str:
    """JSON that can stand inside a script element: no text of it can end the element.

    Args:
        data: The data.

    Returns:
        JSON text.
    """
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")


def _fill(**parts: str) -> str:
    template = (PAGE_FOLDER / "page.html").read_text(encoding="utf-8")
    parts["style"] = (PAGE_FOLDER / "page.css").read_text(encoding="utf-8")
    parts["script"] = _inside_script((PAGE_FOLDER / "player.js").read_text(encoding="utf-8"))
    # One pass: what is filled in is never looked at again.
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)


def _inside_script(text: str) -> str:
    return re.sub(r"<(?=/script|!--)", r"\\x3c", text, flags=re.IGNORECASE)
