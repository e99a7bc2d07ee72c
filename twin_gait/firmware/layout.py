"""How the C looks: names, comments and lines of bounded length."""

import inspect
import re
import textwrap

WIDTH = 100
INDENT = 4
# Words of C99, of its headers and of ours that a name may not be.
TAKEN = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int "
    "long register restrict return short signed sizeof static struct switch typedef union unsigned void "
    "volatile while asm bool true false real NULL INFINITY NAN main".split()
)


def identifier(name: str, taken: frozenset[str] | set[str] = TAKEN) -> str:
    """A name of Python in C: without leading underscores, and another one if it is taken."""
    short = name.lstrip("_") or "unused"
    return f"{short}_" if short in taken else short


def plain(text: str) -> str:
    """A line of a docstring without its markup."""
    text = re.sub(r":\w+:`~?(?:[\w.]*\.)?([^`]+)`", r"\1", text)
    text = re.sub(r"\\[ ,;]", " ", text.replace("``", "").replace(r"\le ", "<= "))
    text = re.sub(r"\\([a-z]+)", r"\1", text)
    return " ".join(text.replace("*/", "* /").split())


def comment(text: str, indent: int = 0) -> list[str]:
    """A comment, on one line if it fits."""
    lines = textwrap.wrap(plain(text), WIDTH - indent - 6, break_long_words=False, break_on_hyphens=False)
    if not lines:
        return []
    pad = " " * indent
    lines = [f"{pad}/* {lines[0]}", *(f"{pad}   {line}" for line in lines[1:])]
    return [*lines[:-1], f"{lines[-1]} */"]


def wrapped(line: str, indent: int) -> list[str]:
    """A statement on as many lines as it needs, no break beside an assignment."""
    pad, further, bond = " " * indent, " " * (indent + 2 * INDENT), "\N{NO-BREAK SPACE}"
    text = line.replace(" = ", f"{bond}={bond}")
    lines = textwrap.wrap(text, WIDTH, initial_indent=pad, subsequent_indent=further, break_on_hyphens=False)
    return [part.replace(bond, " ") for part in lines]


def docstring_of(item: object) -> str:
    """First line of a docstring."""
    return (getattr(item, "__doc__", None) or "").strip().split("\n")[0]


def attributes_of(kind: type) -> dict[str, str]:
    """What comments behind or above the attributes of a class say of them, by name."""
    found: dict[str, str] = {}
    above: list[str] = []
    for line in map(str.strip, inspect.getsource(kind).splitlines()):
        code, _, said = line.partition("# ")
        if entry := re.match(r"(\w+): ", code):
            found[entry[1]] = " ".join(above) or said
        above = [*above, said] if said and not code else []
    return found
