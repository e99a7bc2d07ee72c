"""Layout of the C: names, comments, and lines of bounded length."""

import inspect
import re
import textwrap

from twin_gait.docstrings import docstring_of

WIDTH = 100
INDENT = 4
# Words of C99, of its headers and of this package's headers that are not available as names.
RESERVED_WORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int "
    "long register restrict return short signed sizeof static struct switch typedef union unsigned void "
    "volatile while asm bool true false real NULL INFINITY NAN main".split()
)


def identifier(name: str, taken: frozenset[str] | set[str] = RESERVED_WORDS) -> str:
    """Convert a name of Python to C: without leading underscores, and another one if it is taken."""
    short = name.lstrip("_") or "unused"
    return f"{short}_" if short in taken else short


def strip_markup(text: str) -> str:
    """Return a line of a docstring without its markup."""
    text = re.sub(r":\w+:`~?(?:[\w.]*\.)?([^`]+)`", r"\1", text)
    text = re.sub(r"\\[ ,;]", " ", text.replace("``", "").replace(r"\le ", "<= "))
    text = re.sub(r"\\([a-z]+)", r"\1", text)
    return " ".join(text.replace("*/", "* /").split())


def comment(text: str, indent: int = 0) -> list[str]:
    """Return a comment, on one line if it fits."""
    lines = textwrap.wrap(
        strip_markup(text), WIDTH - indent - 6, break_long_words=False, break_on_hyphens=False
    )
    if not lines:
        return []
    pad = " " * indent
    lines = [f"{pad}/* {lines[0]}", *(f"{pad}   {line}" for line in lines[1:])]
    return [*lines[:-1], f"{lines[-1]} */"]


# Positions at which a line may be broken, best first: after commas, before operators, after an assignment.
_BREAKS = [
    re.compile(found)
    for found in (r"(?<=,) ", r" (?=(?:&&|\|\||\?|:) )", r" (?=(?:\+|-|\|) )", r" (?=(?:\*|/) )", r"(?<= =) ")
]


def wrapped(line: str, indent: int) -> list[str]:
    """Break a statement into lines, at the positions with the fewest open brackets."""
    result, pad = [], " " * indent
    while len(pad) + len(line) > WIDTH:
        limit = WIDTH - len(pad)
        breaks = [
            (_depth(line[: found.start()]), rank, -found.start())
            for rank, pattern in enumerate(_BREAKS)
            for found in pattern.finditer(line)
            if limit // 3 < found.start() <= limit
        ]
        if not breaks:
            break
        end = -min(breaks)[-1]
        result.append(pad + line[:end].rstrip())
        line, pad = line[end:].lstrip(), " " * (indent + 2 * INDENT)
    return [*result, pad + line]


def _depth(text: str) -> int:
    return sum(text.count(left) - text.count(right) for left, right in ("()", "[]", "{}"))


# Comments above an attribute, its name, and a comment after it.
_ATTRIBUTE = re.compile(r"((?: *# .*\n)*) +(\w+): [^#\n]*(?:# (.*))?$", re.MULTILINE)


def attributes_of(kind: type) -> dict[str, str]:
    """Return the descriptions of the attributes of a class by name, from comments or from its docstring.

    A comment is after an attribute or above it. A class has the attributes of the class that it extends, too.
    """
    found = attributes_of(kind.__base__) if kind.__base__ not in (object, None) else {}
    listed = re.findall(r"(\w+): (.*)", docstring_of(kind).partition("Attributes:\n")[2])
    for above, name, behind in _ATTRIBUTE.findall(inspect.getsource(kind)):
        text = " ".join(line.strip(" #") for line in above.splitlines()) or behind
        found |= {name: text} if text else {}
    return dict(listed) | found
