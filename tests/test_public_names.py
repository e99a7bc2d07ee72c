"""Promises about names that users import."""

from __future__ import annotations

import importlib
import pkgutil

from errors import raises

import twin_gait


def test_public_names_exist():
    for name in twin_gait.__all__:
        assert getattr(twin_gait, name) is not None


def test_unknown_name_is_an_attribute_error():
    with raises(AttributeError, "warp", "twin_gait"):
        twin_gait.warp  # noqa: B018


def test_every_module_imports_and_its_public_names_exist():
    names = {item.name for item in pkgutil.walk_packages(twin_gait.__path__, "twin_gait.")}
    for name in sorted(names - {"twin_gait.__main__", "twin_gait._version"}):
        module = importlib.import_module(name)
        assert module.__doc__, f"{name} has no docstring"
        for public in getattr(module, "__all__", ()):
            assert hasattr(module, public), f"{name}.{public}"
