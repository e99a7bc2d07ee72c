"""Configuration of the site: ``python -m sphinx -W docs docs/_build/html``.

By default no script of the gallery and no cell of a tutorial runs: their pages have the code and the stored
figures. With ``TWIN_GAIT_SITE=run`` they run, with ``TWIN_GAIT_SITE=tutorials`` only the cells of short
tutorials; ``TWIN_GAIT_SITE=first_gait`` runs the page whose name contains ``first_gait``.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import functools
import inspect
import os
import re
import sys
import typing
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS), str(DOCS / "extensions"), str(DOCS.parent / "examples")]

import api_pages
import declared
import gallery_pages
from jupyter_cache.executors import utils as notebooks

import twin_gait

RUN = os.environ.get("TWIN_GAIT_SITE", "")  # empty, "run", "tutorials", or a part of a name
LONG_TUTORIALS = {"compare", "controller", "device", "hardware", "sit_stand_walk", "train_a_controller"}
GENERATED = DOCS / "_build" / "gallery_source"
ALL_THAT_RUN = rf"/(?!({'|'.join(sorted(gallery_pages.NOT_RUN))})\.py)[^/]*$"

# Shell cells use the twin-gait of the Python that builds the site.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])

# The output of a command arrives in a notebook in chunks of 100 bytes, which are joined to lines.
notebooks.executenb = functools.partial(notebooks.executenb, coalesce_streams=True)

project = "twin_gait"
author = "The twin_gait developers"
copyright = "The twin_gait developers. BSD-3-Clause. Not a medical device"
version = release = twin_gait.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = [
    "_build",
    "gallery_header.rst",
    "**/GALLERY_HEADER.rst",
    "**.ipynb",
    "gallery/**/*.py",
    "gallery/**/*.json",
]
default_role = "literal"
nitpicky = False
# Tables that the program prints have their own levels of headings (published_machines).
suppress_warnings = ["myst.header"]

# Markdown
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist", "attrs_block"]
myst_heading_anchors = 4
myst_dmath_double_inline = True
nb_execution_mode = "off" if RUN in ("", "none") else "cache"
nb_execution_cache_path = str(DOCS / "_build" / "tutorials")
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_excludepatterns = [
    str(path.relative_to(DOCS))
    for path in DOCS.rglob("*.md")
    if path.stem in (LONG_TUTORIALS if RUN == "tutorials" else ())
    or (RUN not in ("", "run", "tutorials") and RUN not in path.stem)
]
nb_merge_streams = True

# Docstrings
autodoc_typehints = "signature"
autodoc_member_order = "groupwise"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

# Gallery
sphinx_gallery_conf = {
    "examples_dirs": [str(GENERATED)],
    "gallery_dirs": ["gallery"],
    "filename_pattern": {"": "(?!)", "tutorials": "(?!)", "run": ALL_THAT_RUN}.get(RUN, re.escape(RUN)),
    "ignore_pattern": r"(?!)",
    "plot_gallery": RUN not in ("", "tutorials"),
    "parallel": RUN == "run",
    "abort_on_example_error": True,
    "reset_argv": "gallery_run.arguments",
    "image_scrapers": (),
    "reset_modules": ("gallery_run.fresh",),
    "download_all_examples": False,
    "show_memory": False,
    "write_computation_times": False,  # this page would load scripts from other servers
    "remove_config_comments": True,
    "nested_sections": False,
    "within_subsection_order": "gallery_run.Order",
    "copyfile_regex": r"(?!)",
    "show_signature": False,
}

# Pages
html_theme = "pydata_sphinx_theme"
html_title = "twin_gait"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options: dict[str, Any] = {
    "logo": {"text": "twin_gait"},
    "header_links_before_dropdown": 7,
    "navbar_align": "left",
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": ["theme-version"],
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": True,
}
html_sidebars = {"index": [], "glossary": [], "start/index": []}
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True


# Files of the repository that are also pages of the site; they replace the files at these paths in docs/.
INCLUDED = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "urdf/README.md": "background/urdf.md",
}


def _links_inside_the_site(_: Any, name: str, source: list[str]) -> None:
    """Replace links to files of the repository by links to their pages, and links to folders by text."""
    page = DOCS / f"{name}.md"
    origin = page
    for path, page_name in INCLUDED.items():
        if DOCS / page_name == page:
            origin = DOCS.parent / path
            source[0] = origin.read_text(encoding="utf-8")

    def inside(match: re.Match[str]) -> str:
        text, target, anchor = match.groups()
        if "://" in target:
            return match.group()
        path = (origin.parent / target).resolve()
        page_name = str(path.relative_to(DOCS.parent)) if path.is_relative_to(DOCS.parent) else ""
        if path.is_dir():
            return text
        to = DOCS / INCLUDED[page_name] if page_name in INCLUDED else path
        return f"[{text}]({os.path.relpath(to, page.parent)}{anchor or ''})"

    source[0] = re.sub(r"\[([^\]]*)\]\(([^)#\s]+)(#[^)]*)?\)", inside, source[0])


def _document_fields(_: Any, kind: str, __: str, documented: Any, ___: Any, lines: list[str]) -> None:
    """Add the comments of the fields of a record as their documentation."""
    if kind != "class" or not (dataclasses.is_dataclass(documented) or hasattr(documented, "_fields")):
        return
    if any(line.startswith((":ivar", ".. attribute")) for line in lines):
        return
    try:
        found = list(declared.fields_of(documented))
    except (OSError, TypeError):  # no source
        return
    comments = [f":ivar {name}: {meaning}" for name, _type, meaning in found if meaning]
    lines += ["", *comments, ""] if comments else []


def _strip_ranges(_: Any, documented: Any, __: bool) -> None:
    """Reduce signatures to the types of parameters; units and ranges are on the page of keys."""
    if inspect.isfunction(documented):
        with contextlib.suppress(NameError, TypeError):
            documented.__annotations__ = typing.get_type_hints(documented)


def _hide_enum_signatures(
    _: Any, kind: str, __: str, documented: Any, ___: Any, signature: str, returned: str
) -> tuple[str, str | None]:
    """Remove the signature of enumerations, because users do not create members."""
    enumeration = kind == "class" and issubclass(documented, enum.Enum)
    return ("", None) if enumeration else (signature, returned)


def setup(app: Any) -> None:
    """Generate pages before Sphinx searches for them, and connect the handlers."""
    api_pages.prepare(DOCS / "reference" / "api")
    gallery_pages.prepare(GENERATED, run=bool(RUN))
    app.connect("autodoc-before-process-signature", _strip_ranges)
    app.connect("autodoc-process-signature", _hide_enum_signatures)
    app.connect("autodoc-process-docstring", _document_fields)
    app.connect("source-read", _links_inside_the_site)
