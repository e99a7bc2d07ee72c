"""Random gait tables that are small enough to run and unusual enough to be a hard test."""

from __future__ import annotations

from hypothesis import strategies as st
from table_builder import JOINTS, phase

from twin_gait.gait import GaitTable, Transition
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.signals import all_signal_names, signal_of

PHASES = ("stance", "swing", "rest")
_NAMES = all_signal_names(JOINTS)


def _threshold(draw: st.DrawFn, name: str) -> float:
    if name.endswith("time_in_phase_s"):
        return draw(st.integers(-2, 30)) * 1e-3 + draw(st.sampled_from([0.0, 0.0005]))
    return draw(st.sampled_from([-1000.0, -8.0, -0.4, 0.0, 0.3, 5.7, 12.0, 1e5]))


@st.composite
def comparisons(draw: st.DrawFn) -> Comparison:
    signal = draw(st.sampled_from(_NAMES))
    alike = [name for name in _NAMES if signal_of(name).unit == signal_of(signal).unit]
    minus = draw(st.none() | st.sampled_from(alike))
    threshold = _threshold(draw, signal)
    return Comparison(signal=signal, minus=minus, operator=draw(st.sampled_from("<>")), threshold=threshold)


memberships = st.lists(st.sampled_from(PHASES), min_size=1, max_size=3, unique=True).map(
    lambda names: PhaseMembership(phases=tuple(names))
)


def guards() -> st.SearchStrategy[Guard]:
    """Return trees of conditions; a list may contain one condition, or the same condition twice."""

    def lists(inner: st.SearchStrategy[Guard]) -> st.SearchStrategy[Guard]:
        some = st.lists(inner, min_size=1, max_size=3).map(tuple)
        return some.map(lambda items: AllOf(guards=items)) | some.map(lambda items: AnyOf(guards=items))

    return st.recursive(comparisons() | comparisons() | memberships, lists, max_leaves=5)


@st.composite
def transitions(draw: st.DrawFn, source: str) -> Transition:
    kind = draw(st.sampled_from(["guard", "guard", "guard", "both", "time_out"]))
    return Transition(
        source=source,
        target=draw(st.sampled_from([name for name in PHASES if name != source])),
        cause=draw(st.sampled_from(["one", "two", "three"])),
        guard=AllOf(guards=()) if kind == "time_out" else draw(guards()),
        debounce_ticks=draw(st.sampled_from([1, 1, 1, 2, 3, 7])),
        time_out_ticks=None if kind == "guard" else draw(st.integers(12, 40)),
    )


@st.composite
def tables(draw: st.DrawFn) -> GaitTable:
    """Draw a table of three phases, each with one to three exits."""
    entries = [draw(transitions(source)) for source in PHASES for _ in range(draw(st.integers(1, 3)))]
    stays = {name: phase(minimum_ticks=draw(st.sampled_from([0, 0, 1, 2, 9]))) for name in PHASES}
    order = draw(st.permutations(entries))
    return GaitTable(name="random", joints=JOINTS, phases=stays, transitions=tuple(order))
