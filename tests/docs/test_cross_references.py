"""Cross-references: every role in a docstring or comment of the package names something that exists."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from importlib.util import resolve_name
from pathlib import Path
from typing import Any

import pytest

import twin_gait

PACKAGE = Path(twin_gait.__file__).parent
FILES = sorted(str(path.relative_to(PACKAGE.parent)) for path in PACKAGE.rglob("*.py"))
ROLE = re.compile(r":(?:attr|class|const|data|exc|func|meth|mod|obj):`~?([^`]+)`")


def has_member(owner: Any, path: str) -> bool:
    """Return whether a dotted path leads from a module or class to one of its members or fields."""
    name, _, rest = path.partition(".")
    if not rest and name in getattr(owner, "__annotations__", {}):
        return True
    return hasattr(owner, name) and (not rest or has_member(getattr(owner, name), rest))


def is_importable(path: str) -> bool:
    """Return whether a dotted path names a module, or a member of a module."""
    try:
        pkgutil.resolve_name(path)
    except (AttributeError, ImportError):
        return False
    return True


@pytest.mark.parametrize("file", FILES)
def test_every_role_of_a_module_names_something_that_exists(file):
    """A name is relative to the module, to its imports or to a class of the module, or it is absolute."""
    targets = set(ROLE.findall((PACKAGE.parent / file).read_text(encoding="utf-8")))
    if not targets:
        return
    module = importlib.import_module(file.removesuffix(".py").replace("/", ".").removesuffix(".__init__"))
    owners = [module, *(kind for _, kind in inspect.getmembers(module, inspect.isclass))]
    unknown = [
        target
        for target in sorted(targets)
        if not any(has_member(owner, target) for owner in owners)
        and not is_importable(resolve_name(target, module.__package__ or ""))
    ]
    assert not unknown
