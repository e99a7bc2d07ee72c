"""How one gait table extends another, and which entry of which file a mistake is in."""

from pathlib import Path
from typing import Any, NamedTuple

from twin_gait.configuration.validation import converting, merge, packaged, read_yaml, short
from twin_gait.exceptions import ParameterError, ParameterFileError

# Lists of a table, and what an entry of each is about.
_LISTS = {"transitions": ("from", "to", "cause"), "waive": ("rule", "phase", "transition")}


class Place(NamedTuple):
    """Where an entry of a list was written."""

    source: str  # the file
    key: str  # for example ``transitions[2]``, counted in that file


class TableMapping(NamedTuple):
    """A gait table as a mapping, those that it extends laid underneath."""

    data: dict[str, Any]  # the mapping, without ``extends``
    # of the entries of its lists, by their key in the mapping, for example ``transitions[12]``
    places: dict[str, Place]


class _Entry(NamedTuple):
    value: Any
    place: Place
    about: tuple[Any, ...] | None  # None for what the schema refuses


def read_gait_table(path: Path) -> TableMapping:
    """Read a gait table file as a mapping, laid over the table that it extends."""
    return extended_table(read_yaml(path), path, str(path))


def extended_table(
    data: dict[str, Any], path: Path, source: str, below: tuple[Path, ...] = ()
) -> TableMapping:
    """Lay a table over the one that its key ``extends`` names.

    Mappings are laid over each other key by key, as presets are. A transition with the same from, to and
    cause takes the place of the inherited one, ``remove: true`` takes it away; a waiver of the same takes the
    place of the inherited one. Others follow those of the table underneath, which therefore come first where
    two exits are due at once. The name is not taken over.
    """
    lists = {key: _entries(data, key, source) for key in _LISTS}
    if "extends" in data:
        name = data["extends"]
        found = converting(source, "extends", lambda: gait_table_path(name, path.parent))
        chain = (*below, path.resolve())
        if found.resolve() in chain:
            raise ParameterFileError(source, "extends", f"{name!r} extends this table itself")
        base, places = extended_table(read_yaml(found), found, str(found), chain)
        for key, own in lists.items():
            inherited = [item._replace(place=places[item.place.key]) for item in _entries(base, key, "")]
            lists[key] = _laid_over(inherited, own, name)
        data = merge({**base, "name": None}, {key: value for key, value in data.items() if key != "extends"})
        data |= {key: [item.value for item in items] for key, items in lists.items()}
    return TableMapping(
        data, {f"{key}[{place}]": item.place for key in lists for place, item in enumerate(lists[key])}
    )


def _entries(data: dict[str, Any], key: str, source: str) -> list[_Entry]:
    items = data.get(key) or []
    if not isinstance(items, list):
        raise ParameterFileError(source, key, f"expected a list, got {short(items)}")
    return [
        _Entry(item, Place(source, f"{key}[{place}]"), _about(key, item)) for place, item in enumerate(items)
    ]


def _about(key: str, item: Any) -> tuple[Any, ...] | None:
    names = tuple(item.get(name) for name in _LISTS[key]) if isinstance(item, dict) else (0,)
    return names if all(name is None or isinstance(name, str) for name in names) else None


def _laid_over(inherited: list[_Entry], own: list[_Entry], base: str) -> list[_Entry]:
    """Entries of two lists as one, each replaced one where the inherited one stood."""
    said: dict[Any, list[_Entry]] = {}
    for item in own:
        said.setdefault(item.about, []).append(item)
    merged = [mine for item in inherited for mine in said.pop(item.about, [item])]
    for item in own:
        more = [name for name in item.value if name not in (*_LISTS["transitions"], "remove")]
        if _removes(item) and more:
            problem = f"{more[0]}: remove takes nothing beside from, to and cause"
            raise ParameterFileError(*item.place, problem)
    for item in (added := [mine for items in said.values() for mine in items]):
        if _removes(item):
            source, target, cause = item.about or ()
            problem = f"nothing to remove: {base} has no {source} → {target} ({cause})"
            raise ParameterFileError(*item.place, problem)
    return [item for item in merged + added if not _removes(item)]


def _removes(item: _Entry) -> bool:
    return item.about is not None and "from" in item.value and item.value.get("remove") is True


def gait_table_path(
    name: Any, folder: Path | None = None, kind: str = "tables", words: str = "gait table"
) -> Path:
    """File of a gait table, or of another kind of table."""
    shipped = packaged(kind)
    if isinstance(name, str | Path):
        beside = [] if folder is None else [folder / name]
        for candidate in (*beside, Path(name).expanduser(), shipped.get(str(name))):
            if candidate is not None and candidate.is_file():
                return candidate
    shown = short(name) if isinstance(name, list | dict) else repr(str(name))
    raise ParameterError(f"no {words} {shown}: neither a file nor one of {', '.join(shipped)}")


def packaged_gait_tables() -> list[str]:
    """Names of the gait tables that ship with the package."""
    return list(packaged("tables"))
