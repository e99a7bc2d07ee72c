"""Signals of episodes: values of the state records of many episodes, by the names of the log's columns.

The expressions of the log (:mod:`twin_gait.simulation.log`) say where a record has each value, so that an
environment reads the values without writing a log.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from twin_gait.control.controllers.policy import Policy
from twin_gait.exceptions import ParameterError
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.log import ColumnGroup

# Signals of a leg that the gait controller has and the log has not, by the end of their name.
LEG = ColumnGroup(
    {
        "foot_load": ("e.controller.legs[n].load", "foot load that the gait controller receives"),
        "phase_entry_tick": ("e.controller.legs[n].entry_tick", "tick in which the phase was entered"),
    }
)
# Signals of an episode.
EPISODE = ColumnGroup(
    {
        "status": ("e.status", "status: 0 unless the wearer fell or the state diverged"),
        "trip_tick": ("e.controller.trip.tick", "tick in which the monitor tripped; -1 before it"),
    }
)
# Ends of the names of the log's columns that the loop computes only if it writes a log.
LOGGED_ONLY = (
    "_external_torque_Nm", "_disturbance_torque_Nm", "_normal_force_N", "_friction_force_N", "_clearance_m",
    "_cop_ratio", "_kinetic_energy_J", "_potential_energy_J", "_guide_force_N", "_guide_moment_Nm", "_work_J",
    "_friction_torque_Nm", "_stop_torque_Nm", "_spring_torque_Nm", "_orthosis_torque_Nm", "_brace_torque_Nm",
    "_brace_force_N", "_own_torque_Nm",
)  # fmt: skip


class _Location:
    """Place in a record of 64-bit words, which is followed by attributes and indices like the record itself.

    As an index it is the integer that the record has at this place.
    """

    def __init__(self, words: np.ndarray, dtype: np.dtype[Any], first: int, shape: tuple[int, ...]) -> None:
        self._words, self._dtype, self._first, self._shape = words, dtype, first, shape

    def __getattr__(self, name: str) -> "_Location":
        if self._dtype.fields is None or name not in self._dtype.fields:
            raise AttributeError(name)
        kind, offset, *_ = self._dtype.fields[name]
        entry, shape = kind.subdtype or (kind, ())
        return _Location(self._words, entry, self._first + offset // 8, shape)

    def __getitem__(self, index: Any) -> "_Location":
        size = self._dtype.itemsize // 8 * int(np.prod(self._shape[1:], dtype=int))
        position = range(self._shape[0])[index]  # raises IndexError, negative indices count from the end
        return _Location(self._words, self._dtype, self._first + position * size, self._shape[1:])

    def __index__(self) -> int:
        return int(self._words[self._first])

    def __add__(self, number: int) -> int:
        return int(self) + number

    __int__ = __index__


def words_of(place: Any) -> np.ndarray:
    """Return the indices of all words at a place of a record, in the shape of the entries and their words."""
    words, shape = place._dtype.itemsize // 8, place._shape
    count = int(np.prod(shape, dtype=int)) * words
    return np.arange(place._first, place._first + count).reshape(*shape, words)


def word_of(place: Any) -> int:
    """Return the index of the only word at a place of a record; raises TypeError if there are several."""
    found = words_of(place)
    if found.size != 1:
        raise TypeError("a place of several words")
    return int(found.item())


class RecordMap:
    """Indices of the values in the records of one pattern, by name.

    Attributes:
        names: Names of the signals: columns of the log, and those of this module.
    """

    def __init__(self, engine: CompiledEngine) -> None:
        """Find all signals of an engine."""
        self._words = engine.store.view(np.int64)
        self._pattern = engine.store.dtype, engine.layout.names
        self.root: Any = _Location(self._words, engine.store.dtype, 0, ())
        flags = dict(engine.build_flags)
        self._places: dict[str, tuple[int, bool]] = {}
        self._matching: dict[str, list[str]] = {}
        legs = ((f"{side}_", number, LEG) for number, side in enumerate(engine.setup.sides))
        groups = [*engine.layout.groups, *legs, *_policy_inputs(engine), ("", 0, EPISODE)]
        for prefix, number, group in groups:
            scope = {**flags, "e": self.root, "n": number}
            exec(group.preamble, scope)  # expressions of this package, no text of a user
            for name, (expression, _) in group.columns.items():
                place = _evaluate(expression, scope)
                if place is not None and not f"_{prefix}{name}".endswith(LOGGED_ONLY):
                    self._places[prefix + name] = word_of(place), place._dtype.kind == "i"
        self.names = tuple(self._places)

    def fits(self, engine: CompiledEngine) -> bool:
        """Return whether the records of an engine have the same pattern, of the same joints."""
        return self._pattern == (engine.store.dtype, engine.layout.names)

    def index(self, name: str) -> tuple[int, bool]:
        """Return the index of the word of a signal, and whether it is an integer.

        Raises ParameterError for a name that is none of :attr:`names`.
        """
        place = self._places.get(name)
        if place is None:
            expected = (
                "a signal that is computed without a log; the attribute signal_names lists all, such as"
            )
            raise ParameterError(f"signal {name!r}: expected {expected} {', '.join(self.names[:3])}")
        return place

    def matching(self, name: str) -> list[str]:
        """Return a signal, or all signals of legs and joints whose names end with an underscore and a name.

        Raises ParameterError if there is none.
        """
        if name not in self._matching:
            ends = [key for key in self.names if key.endswith(f"_{name}")]
            found = [name] if name in self._places else ends
            if not found:
                self.index(name)
            self._matching[name] = found
        return self._matching[name]


def _policy_inputs(engine: CompiledEngine) -> Iterator[tuple[str, int, ColumnGroup]]:
    """Yield the inputs of a policy by leg, as signals whose names end with ``policy_input``."""
    controller = engine.setup.controller
    if isinstance(controller, Policy):
        names = controller.network.input_names
        for leg, side in enumerate(engine.setup.sides):
            columns = {
                f"{name}_policy_input": (f"e.controller.memory.inputs[{leg * len(names) + index}]", "input")
                for index, name in enumerate(names)
            }
            yield f"{side}_", leg, ColumnGroup(columns)


def _evaluate(expression: str, scope: Mapping[str, Any]) -> _Location | None:
    """Return the place of one value, or None for an expression that computes a value from others."""
    try:
        found = eval(expression, dict(scope))  # an expression of this package, no text of a user
        return found if isinstance(found, _Location) and words_of(found).size == 1 else None
    except (TypeError, AttributeError, IndexError):
        return None


class Signals:
    """Present values of all episodes, by name: ``signals["left_knee_measured_angle_rad"]``.

    Attributes:
        tick: Ticks since the start of each episode, shape ``(n,)``.
        period: Time of a control step in [s].
        ticks: Ticks of a control step.
        derived: Values that no record has, by name, shape ``(n,)`` each: mass, limits, reference angles.
    """

    def __init__(self, places: RecordMap, words: np.ndarray, ticks: int, period: float) -> None:
        """Store the records: ``words`` are their 64-bit words, shape ``(n_words, n)``, which change."""
        self.places, self._integers, self._numbers = places, words, words.view(float)
        self.ticks, self.period = ticks, period
        count = words.shape[1]
        self.tick = np.zeros(count, dtype=np.int64)
        self.derived: dict[str, np.ndarray] = {}
        self._previous: dict[str, np.ndarray] = {}
        self._found: dict[str, np.ndarray] = {}
        self._stacked: dict[tuple[str, ...], np.ndarray] = {}
        self._words: dict[tuple[str, ...], np.ndarray | None] = {}  # Words of stacks that are read at once.
        self._names: dict[str, list[str]] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the values of a signal in the unit of its name, shape ``(n,)``."""
        found = self._found.get(name)
        if found is None:
            if name in self.derived:
                return self.derived[name]
            index, integer = self.places.index(name)
            found = self._integers[index].astype(float) if integer else self._numbers[index].copy()
            self._found[name] = found
        return found

    def each(self, name: str) -> np.ndarray:
        """Return the values of a signal of every leg or joint, in the order of the log, shape ``(m, n)``."""
        return self.stack(self.names(name))

    def stack(self, names: Sequence[str]) -> np.ndarray:
        """Return the values of some signals, shape ``(m, n)``."""
        key = tuple(names)
        found = self._stacked.get(key)
        if found is None:
            found = self._gather(key)
            self._stacked[key] = found
        return found

    def _gather(self, names: tuple[str, ...]) -> np.ndarray:
        """Read some signals at once if none is derived or an integer, otherwise one by one."""
        if names not in self._words:
            places = [(0, True) if name in self.derived else self.places.index(name) for name in names]
            plain = not any(integer for _, integer in places)
            self._words[names] = np.array([word for word, _ in places]) if plain else None
        words = self._words[names]
        return np.array([self[name] for name in names]) if words is None else self._numbers[words]

    def names(self, name: str) -> list[str]:
        """Return the full names of the signals that end with a name; ParameterError if there is none."""
        if name not in self._names:
            derived = [item for item in self.derived if item == name or item.endswith(f"_{name}")]
            self._names[name] = derived or self.places.matching(name)
        return self._names[name]

    def change(self, name: str) -> np.ndarray:
        """Return the change of a signal since the last control step; zero if this is the first request."""
        now = self[name]
        return np.asarray(now - self._previous.setdefault(name, now))

    def store_previous(self) -> None:
        """Store the values whose changes are computed, before the records change."""
        for name in self._previous:
            self._previous[name] = self[name]

    def refresh(self) -> None:
        """Discard the values that have been read, because the records have changed."""
        self._found.clear()
        self._stacked.clear()


ObservationTerm = Callable[[Signals], np.ndarray]
