"""Checks of messages that depend on the facts in them and not on their wording.

A fact is a key, a value, a limit, an accepted value, a unit, a file name or an option. It must occur in the
message as a whole: ``hip`` is in ``expected hip or knee`` and in ``left hip``, but neither in ``hips`` nor in
``left_hip_deg``; ``1`` is in ``at least 1`` but not in ``1.5``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import pytest

Raised = TypeVar("Raised", bound=BaseException)


def states(text: str, *facts: object) -> bool:
    """Return whether a text states all facts, in any order."""
    return not missing(text, *facts)


def missing(text: str, *facts: object) -> list[str]:
    """Return the facts that a text does not state."""
    return [str(fact) for fact in facts if not re.search(_pattern(str(fact)), text)]


def _pattern(fact: str) -> str:
    """Return a pattern that finds a fact as a whole word, number or path."""
    before = r"(?<![\w])" if re.match(r"\w", fact) else ""
    if re.match(r"\d", fact):
        before = r"(?<![\w])(?<!\d\.)(?<!\w-)(?<![\s(]-)"  # neither in a decimal nor with another sign
    after = r"(?!\w)(?!\.\d)" if re.search(r"\d$", fact) else r"(?!\w)" if re.search(r"\w$", fact) else ""
    return before + re.escape(fact) + after


@contextmanager
def raises(
    kind: type[Raised] | tuple[type[Raised], ...], *facts: object
) -> Iterator[pytest.ExceptionInfo[Raised]]:
    """Expect an error of a kind whose message states facts, and yield the result of ``pytest.raises``."""
    assert facts, "name the facts that the message states"
    with pytest.raises(kind) as caught:
        yield caught
    _require(str(caught.value), facts)


@contextmanager
def warns(kind: type[Warning], *facts: object) -> Iterator[pytest.WarningsRecorder]:
    """Expect a warning of a kind whose message states facts, and yield the result of ``pytest.warns``."""
    assert facts, "name the facts that the message states"
    with pytest.warns(kind) as issued:
        yield issued
    texts = [str(item.message) for item in issued if issubclass(item.category, kind)]
    best = min(texts, key=lambda text: len(missing(text, *facts)))
    _require(best, facts)


def _require(message: str, facts: tuple[object, ...]) -> None:
    """Fail if a message does not state all facts."""
    lacking = missing(message, *facts)
    assert not lacking, f"{', '.join(lacking)}: not in the message: {message}"
