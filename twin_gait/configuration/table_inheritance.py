"""How one gait table extends another, and which entry of which file a mistake is in."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from twin_gait.configuration.validation import converting, merge, packaged, read_yaml, short
from twin_gait.exceptions import ParameterError, ParameterFileError

_IDENTITY = ("from", "to", "cause")
_LISTS = ("transitions", "waive")


class Place(NamedTuple):
    """Where an entry of a list was written."""

    source: str  # the file
    key: str  # for example ``transitions[2]``, counted in that file


class TableMapping(NamedTuple):
    """A gait table as a mapping, those that it extends laid underneath."""

    data: dict[str, Any]  # the mapping, without ``extends``
    # of the entries of its lists, by their key in the mapping, for example ``transitions[12]``
    places: Mapping[str, Place]


class _Entry(NamedTuple):
    value: Any
    place: Place

    @property
    def identity(self) -> tuple[Any, ...] | None:
        """From, to and cause of a transition; None if one of them is no text, which the schema refuses."""
        names = tuple(self.value.get(key) for key in _IDENTITY) if isinstance(self.value, dict) else (None,)
        return names if all(isinstance(name, str) for name in names) else None


def read_gait_table(path: Path) -> TableMapping:
    """Read a gait table file as a mapping, laid over the table that it extends."""
    return extended_table(read_yaml(path), path, str(path))


def extended_table(
    data: dict[str, Any], path: Path, source: str, below: tuple[Path, ...] = ()
) -> TableMapping:
    """Lay a table over the one that its key ``extends`` names.

    Mappings are laid over each other key by key, as presets are. A transition with the same from, to and
    cause takes the place of the inherited one, ``remove: true`` takes it away; other transitions and waivers
    follow those of the table underneath, which therefore come first where two exits are due at once.
    Inherited waivers about causes that were removed go with them, and an own one for the same takes the place
    of an inherited one. The name is not taken over.
    """
    own = {key: _listed(data, key, source) for key in _LISTS}
    check_twice(data, source)
    if "extends" not in data:
        return TableMapping(data, _places(own))
    name = data["extends"]
    if not isinstance(name, str):
        raise ParameterFileError(source, "extends", f"no gait table {name!r}; expected a name or a path")
    found = converting(source, "extends", lambda: gait_table_path(name, path.parent))
    chain = (*below, path.resolve())
    if found.resolve() in chain:
        raise ParameterFileError(source, "extends", f"{data['extends']!r} extends this table itself")
    base, places = extended_table(read_yaml(found), found, str(found), chain)
    inherited = {
        key: [_Entry(item, places[f"{key}[{index}]"]) for index, item in enumerate(base.get(key) or [])]
        for key in _LISTS
    }
    transitions = _transitions(inherited["transitions"], own["transitions"], data["extends"])
    gone = _causes(inherited["transitions"]) - _causes(transitions)
    said = [_waived(item.value) for item in own["waive"]]
    inherited_waivers = [
        item
        for item in inherited["waive"]
        if not _is_about(item.value, gone) and _waived(item.value) not in said
    ]
    waivers = inherited_waivers + own["waive"]
    lists = {"transitions": transitions, "waive": waivers}
    rest = {key: value for key, value in data.items() if key != "extends"}
    merged = merge({key: value for key, value in base.items() if key != "name"}, rest)
    return TableMapping(
        merged | {key: [item.value for item in items] for key, items in lists.items()}, _places(lists)
    )


def _transitions(inherited: list[_Entry], own: list[_Entry], base: str) -> list[_Entry]:
    """Transitions of two tables as one list, each replaced one where the inherited one stood."""
    known = {item.identity for item in inherited}
    said = {item.identity: item for item in own}
    added = []
    for item in own:
        if _removes(item):
            _check_removal(item, inherited, base)
        elif item.identity is None or item.identity not in known:
            added.append(item)
    merged = []
    for item in inherited:
        mine = said.get(item.identity, item)
        if not _removes(mine) and mine not in merged:
            merged.append(mine)
    return merged + added


def check_twice(data: dict[str, Any], source: str) -> None:
    """Refuse two transitions that neither the log nor a table that extends this one could tell apart."""
    said: dict[tuple[Any, ...], str] = {}
    for item in _listed(data, "transitions", source):
        if item.identity in said:
            problem = f"the same from, to and cause as {said[item.identity]}"
            raise ParameterFileError(*item.place, f"{problem}; leave one out, or give it another cause")
        if item.identity is not None:
            said[item.identity] = item.place.key


def _removes(item: _Entry) -> bool:
    return isinstance(item.value, dict) and item.value.get("remove") is True and item.identity is not None


def _check_removal(item: _Entry, inherited: list[_Entry], base: str) -> None:
    """Refuse to remove what is not there, and a removal that says more than what it removes."""
    more = [key for key in item.value if key not in (*_IDENTITY, "remove")]
    if more:
        raise ParameterFileError(*item.place, f"{more[0]}: remove takes nothing beside from, to and cause")
    if item.identity not in {other.identity for other in inherited}:
        source, target, cause = item.value["from"], item.value["to"], item.value["cause"]
        leaving = [other.value for other in inherited if other.identity and other.identity[0] == source]
        known = ", ".join(f"{other['to']} ({other['cause']})" for other in leaving) or "none"
        raise ParameterFileError(
            *item.place,
            f"nothing to remove: {base} has no {source} → {target} ({cause}); its exits of {source}: {known}",
        )


def _causes(items: list[_Entry]) -> set[str]:
    return {item.identity[2] for item in items if item.identity is not None}


def _waived(waiver: Any) -> Any:
    """What a waiver accepts, without its reason."""
    if not isinstance(waiver, dict):
        return waiver
    return {key: value for key, value in waiver.items() if key != "reason"}


def _is_about(waiver: Any, causes: set[str]) -> bool:
    return isinstance(waiver, dict) and str(waiver.get("transition")) in causes


def _places(lists: Mapping[str, list[_Entry]]) -> dict[str, Place]:
    return {f"{key}[{index}]": item.place for key, items in lists.items() for index, item in enumerate(items)}


def _listed(data: dict[str, Any], key: str, source: str) -> list[_Entry]:
    items = data.get(key) or []
    if not isinstance(items, list):
        raise ParameterFileError(source, key, f"expected a list, got {short(items)}")
    return [_Entry(item, Place(source, f"{key}[{index}]")) for index, item in enumerate(items)]


@contextmanager
def own_entries_named(places: Mapping[str, Place]) -> Iterator[None]:
    """Let mistakes in an entry of a list name the file and the entry that the user wrote."""
    try:
        yield
    except ParameterFileError as error:
        key, problem = error.key, error.problem
        merged = re.match(r"(?:transitions|waive)\[\d+\]", key or problem)
        place = places.get(merged[0]) if merged else None
        if merged is None or place is None:
            raise
        where = (key or problem).replace(merged[0], place.key, 1)
        raise ParameterFileError(place.source, *((where, problem) if key else ("", where))) from error


def gait_table_path(
    name: str | Path, folder: Path | None = None, kind: str = "tables", words: str = "gait table"
) -> Path:
    """File of a gait table, or of another kind of table."""
    beside = [] if folder is None else [folder / name]
    shipped = packaged(kind)
    for candidate in (*beside, Path(name).expanduser(), shipped.get(str(name))):
        if candidate is not None and candidate.is_file():
            return candidate
    known = ", ".join(shipped)
    raise ParameterError(f"no {words} {str(name)!r}: neither a file nor one of {known}")


def packaged_gait_tables() -> list[str]:
    """Names of the gait tables that ship with the package."""
    return list(packaged("tables"))
