"""The controllers that ship: one module for each, or for a few similar ones; their names are the modes."""

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules

from twin_gait.control.controller import Controller


def _shipped() -> Iterator[type[Controller]]:
    for item in iter_modules(__path__):
        for kind in vars(import_module(f"{__name__}.{item.name}")).values():
            if isinstance(kind, type) and issubclass(kind, Controller) and kind.mode:
                yield kind


CONTROLLERS = {kind.mode: kind for kind in _shipped()}
