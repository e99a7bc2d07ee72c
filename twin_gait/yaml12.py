"""Reading and writing of YAML by the core schema of YAML 1.2: ``060`` is 60; ``1_000`` and ``yes`` are texts.

PyYAML resolves plain scalars by YAML 1.1, where ``060`` is 48 and ``1:30`` is 90. Only the tags of the core
schema are constructed. Reference: https://yaml.org/spec/1.2.2/#103-core-schema
"""

import re
from pathlib import Path
from typing import Any, ClassVar

import yaml

# Largest number of values after aliases are expanded; a file of 1 MB without aliases has half as many.
MOST_VALUES = 1_000_000

_TAG = "tag:yaml.org,2002:"
# pattern and first characters of each tag that a plain scalar resolves to
_PLAIN = {
    "null": (r"~|null|Null|NULL|", "~nN"),
    "bool": (r"true|True|TRUE|false|False|FALSE", "tTfF"),
    "int": (r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    "float": (
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        "-+.0123456789",
    ),
}
_RESOLVERS = {
    _TAG + name: (re.compile(f"(?:{pattern})$"), [*first, *([""] if name == "null" else [])])
    for name, (pattern, first) in _PLAIN.items()
}


class Loader(yaml.SafeLoader):
    """Safe loader of the core schema, which rejects aliases that expand to more than ``MOST_VALUES``."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  # the type that PyYAML declares
    yaml_constructors: ClassVar[dict[str | None, Any]] = {
        tag: yaml.SafeLoader.yaml_constructors[tag]
        for tag in (_TAG + "str", _TAG + "seq", _TAG + "map", None)
    }

    def get_single_node(self) -> yaml.Node | None:
        """Return the document as nodes; raise yaml.YAMLError if its aliases expand to too many values."""
        node: yaml.Node | None = super().get_single_node()
        if node is not None and _values_in(node, {}) > MOST_VALUES:
            problem = f"its aliases expand to more than {MOST_VALUES} values; use fewer aliases"
            raise yaml.composer.ComposerError(None, None, problem, node.start_mark)
        return node


def _values_in(node: yaml.Node, known: dict[int, int | None]) -> int:
    """Count the values of a node as often as aliases repeat them; ``known``: counts by identity."""
    if id(node) in known:
        count = known[id(node)]
        if count is None:
            problem = "an alias must not contain itself"
            raise yaml.composer.ComposerError(None, None, problem, node.start_mark)
        return count
    known[id(node)], count = None, 1
    if isinstance(node, yaml.SequenceNode):
        count += sum(_values_in(item, known) for item in node.value)
    elif isinstance(node, yaml.MappingNode):
        count += sum(_values_in(item, known) for pair in node.value for item in pair)
    known[id(node)] = count
    return count


def _construct_plain(loader: Loader, node: yaml.ScalarNode) -> Any:
    """Construct the value of a scalar that has one of the tags of ``_PLAIN``, written or resolved."""
    text = str(loader.construct_scalar(node))
    if not _RESOLVERS[node.tag][0].match(text):
        problem = f"expected a value of {node.tag.removeprefix(_TAG)}, got {text[:40]!r}"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
    if node.tag == f"{_TAG}null":
        return None
    if node.tag == f"{_TAG}bool":
        return text.lower() == "true"
    if node.tag == f"{_TAG}float":
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return int(text[2:], 8 if text[1] == "o" else 16) if text[1:2] in ("o", "x") else int(text)


class Dumper(yaml.SafeDumper):
    """Safe dumper that quotes each text that YAML 1.1 or 1.2 would resolve to another type."""


for _tag, (_pattern, _first) in _RESOLVERS.items():
    Loader.add_implicit_resolver(_tag, _pattern, _first)
    Dumper.add_implicit_resolver(_tag, _pattern, _first)
    Loader.add_constructor(_tag, _construct_plain)


def _represent_text(dumper: Dumper, text: str) -> yaml.ScalarNode:
    """Represent a text; one of several lines becomes a block that stays readable."""
    return dumper.represent_scalar(f"{_TAG}str", text, style="|" if "\n" in text else None)


def _represent_list(dumper: Dumper, items: list[Any]) -> yaml.SequenceNode:
    """Represent a list; one of numbers, such as a curve, is in brackets instead of one number a line."""
    numbers = bool(items) and all(type(item) in (int, float) for item in items)
    return dumper.represent_sequence(f"{_TAG}seq", items, flow_style=numbers or None)


Dumper.add_representer(str, _represent_text)
Dumper.add_representer(list, _represent_list)


def load_yaml(text: str) -> Any:
    """Return the value of a YAML document; raise yaml.YAMLError if it is not valid."""
    return yaml.load(text, Loader=Loader)  # a SafeLoader subclass


class _DataLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Loader that parses in C if libyaml is there; its messages are less exact."""

    yaml_implicit_resolvers = Loader.yaml_implicit_resolvers
    yaml_constructors = Loader.yaml_constructors


def load_data(path: Path) -> Any:
    """Return the value of a YAML file of this package."""
    return yaml.load(path.read_text(encoding="utf-8"), Loader=_DataLoader)


def dump_yaml(mapping: dict[str, Any]) -> str:
    """Return a mapping as YAML text, its keys in their own order."""
    return str(yaml.dump(mapping, Dumper=Dumper, sort_keys=False, allow_unicode=True, width=110))
