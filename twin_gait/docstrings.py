"""Docstrings that the program displays: meanings of parameters, rules of the check, help of commands."""

import ast
import inspect
import sys
import textwrap
from functools import cache
from typing import Any


@cache
def docstring_of(item: Any) -> str:
    """Return the docstring of a class or function without its indentation; empty if it has none.

    ``python -OO`` removes docstrings, and a dataclass then describes itself by its signature; it is
    therefore read from the source.
    """
    if sys.flags.optimize < 2:
        return inspect.cleandoc(item.__doc__ or "")
    try:
        node = ast.parse(textwrap.dedent(inspect.getsource(item))).body[0]
    except (OSError, TypeError):  # code typed at a prompt has no source
        return ""
    documented = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    return ast.get_docstring(node) or "" if isinstance(node, documented) else ""


def summary_of(item: Any) -> str:
    """Return the first line of the docstring of a class or function; empty if it has none."""
    return docstring_of(item).partition("\n")[0]
