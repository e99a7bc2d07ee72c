"""The frame of every report in HTML: one file that loads nothing, and its footer."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable

# The page may show what it holds and load nothing.
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"

# Of the plain reports; those with a look of their own bring their own.
PLAIN_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222;
  max-width: 1150px; margin: 2em auto; padding: 0 1em; }
img { max-width: 100%; }
p, li { max-width: 60em; }
table { border-collapse: collapse; font-size: 13px; margin: 0.6em 0; }
th, td { padding: 2px 10px; text-align: right; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
summary { cursor: pointer; }
footer { color: #666; font-size: 12px; margin-top: 2em; }
@media print { body { margin: 0; font-size: 12px; } section { break-inside: avoid; } }
"""


def html_page(title: str, body: str, *, version: str, style: str = PLAIN_STYLE) -> str:
    """Frame a report.

    Args:
        title: In words; escaped here.
        body: HTML below the title.
        version: Of this package, for the footer.
        style: CSS.

    Returns:
        A page that needs no other file.
    """
    words = html.escape(title)
    maker = f"twin_gait {html.escape(version)}"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<title>{words}</title>
<style>{style}</style>
</head>
<body>
<h1>{words}</h1>
{body}
<footer>Simulated by {maker}; not measured on a person. Not a medical device.</footer>
</body>
</html>
"""


def paragraphs(texts: Iterable[str]) -> str:
    """Texts as paragraphs, escaped.

    Args:
        texts: One for each.

    Returns:
        HTML.
    """
    return "\n".join(f"<p>{html.escape(text)}</p>" for text in texts)


def picture_source(png: bytes) -> str:
    """A picture as the source of an image that needs no other file.

    Args:
        png: Content of a PNG file.

    Returns:
        A ``data:`` address.
    """
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
