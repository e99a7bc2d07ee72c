"""All recipes, in the order of the thesis."""

from __future__ import annotations

from collections.abc import Sequence

from twin_gait.exceptions import ParameterError
from twin_gait.studies.reproduction import (
    breakaway_figure,
    control_figures,
    duty_figures,
    fall_figures,
    friction_figures,
    law_figures,
    table_figure,
    velocity_figure,
)
from twin_gait.studies.reproduction.claim import Recipe

_MODULES = (
    control_figures,
    velocity_figure,
    friction_figures,
    law_figures,
    table_figure,
    duty_figures,
    fall_figures,
    breakaway_figure,
)


def _place(recipe: Recipe) -> tuple[bool, bool, str, int]:
    """Figures and tables by chapter and number, appendices after chapters, then what has no number."""
    kind, _, number = recipe.key.partition("-")
    chapter, _, item = number.partition(".")
    if kind not in ("fig", "table") or not item.isdigit():
        return (True, True, "", 0)
    return (False, not chapter.isdigit(), chapter, int(item) + 100 * (kind == "table"))


RECIPES: tuple[Recipe, ...] = tuple(
    sorted((recipe for module in _MODULES for recipe in module.RECIPES), key=_place)
)


def find_recipes(keys: Sequence[str]) -> tuple[Recipe, ...]:
    """Look recipes up.

    Args:
        keys: As the user wrote them; empty for all.

    Returns:
        The recipes in the order of the thesis, each once.

    Raises:
        ParameterError: If there is no recipe of a key.
    """
    known = {recipe.key: recipe for recipe in RECIPES}
    for key in keys:
        if key not in known:
            raise ParameterError(f"--only: no {key!r}; there are {', '.join(known)}")
    return tuple(recipe for recipe in RECIPES if not keys or recipe.key in keys)
