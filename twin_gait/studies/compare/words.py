"""What a comparison means, in plain words that are computed from its numbers."""

from __future__ import annotations

from collections.abc import Sequence

from twin_gait.studies.compare.comparing import Comparison
from twin_gait.studies.compare.controllers import Controller
from twin_gait.studies.compare.measures_shown import SHOWN, text_of

HOT = 1.0  # RMS current over the continuous one
UNEVEN = 0.05  # of a symmetry index; less is not called asymmetry
SPRINGLESS = ("transparent", "gravity")
_BY_NUMBER = {item.number: item for item in SHOWN}


def paragraphs(comparison: Comparison) -> list[str]:
    """What the numbers mean.

    Args:
        comparison: The comparison.

    Returns:
        A few paragraphs.
    """
    walking = [item for item in comparison.controllers if comparison.walked(item.name) > 0]
    found = [_walked(comparison)]
    if walking:
        found += [
            " ".join(
                [_torques(comparison, walking), _opposing(comparison, walking), _help(comparison, walking)]
            ),
            " ".join([_sides(comparison, walking), _battery(comparison, walking)]),
        ]
    return [text.strip() for text in found if text.strip()]


def _walked(comparison: Comparison) -> str:
    days = f"all {comparison.seeds} days" if comparison.seeds > 1 else "to the end"
    whole = [
        item.title for item in comparison.controllers if comparison.walked(item.name) == comparison.seeds
    ]
    parts = [f"Walked {days}: {_list(whole)}." if whole else "No controller walked to the end."]
    ended = "on average it ended" if comparison.seeds > 1 else "it ended"
    for item in comparison.controllers:
        count = comparison.walked(item.name)
        if count < comparison.seeds:
            seconds = comparison.interval(item.name, "walked_s").mean
            often = f" ({count} of {comparison.seeds} days)" if count else ""
            parts.append(f"{_begin(item.title)} did not{often}: {ended} after {seconds:.1f} s.")
    if any(item.name in SPRINGLESS and not comparison.walked(item.name) for item in comparison.controllers):
        parts.append("Without a spring nothing carries the body but the wearer's own legs.")
    return " ".join(parts)


def _begin(text: str) -> str:
    return text[0].upper() + text[1:]


def _list(items: Sequence[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


def _shown(comparison: Comparison, controller: Controller, number: str) -> str:
    return text_of(comparison.interval(controller.name, number), _BY_NUMBER[number])


def _extremes(
    comparison: Comparison, walking: Sequence[Controller], number: str
) -> tuple[Controller, Controller]:
    """Controllers with the least and the most of a number."""
    ordered = sorted(walking, key=lambda item: comparison.interval(item.name, number).mean)
    return ordered[0], ordered[-1]


def _torques(comparison: Comparison, walking: Sequence[Controller]) -> str:
    least, most = _extremes(comparison, walking, "hip_interaction_rms_Nm")
    text = _shown(comparison, most, "hip_interaction_rms_Nm")
    if least is most:
        return f"The device does {text} N m on the hip with {most.title}."
    return (
        f"The device does most on the hip with {most.title} ({text} N m) and least with {least.title} "
        f"({_shown(comparison, least, 'hip_interaction_rms_Nm')} N m)."
    )


def _opposing(comparison: Comparison, walking: Sequence[Controller]) -> str:
    if all(comparison.interval(item.name, "effort_rms_Nm").mean == 0.0 for item in walking):
        return "The wearer makes no effort, so that the device does all the work."
    least, most = _extremes(comparison, walking, "wearer_work_share")
    against = _extremes(comparison, walking, "opposing_rms_Nm")[1]
    share = _shown(comparison, most, "wearer_work_share")
    text = (
        f"The wearer does {share} % of the work with {most.title}"
        if least is most
        else f"The wearer does most of the work himself with {most.title} ({share} %), least with "
        f"{least.title} ({_shown(comparison, least, 'wearer_work_share')} %)"
    )
    return (
        f"{text}. Device and wearer work against each other most with {against.title} "
        f"({_shown(comparison, against, 'opposing_rms_Nm')} N m)."
    )


def _help(comparison: Comparison, walking: Sequence[Controller]) -> str:
    adapting = [item for item in walking if item.name == "assist_as_needed"]
    if not adapting:
        return ""
    hip, knee = (
        comparison.interval(adapting[0].name, f"{joint}_help_share").mean for joint in ("hip", "knee")
    )
    return (
        f"Assist as needed came down to {100.0 * hip:.0f} % of the spring at the hip and "
        f"{100.0 * knee:.0f} % at the knee."
    )


def _sides(comparison: Comparison, walking: Sequence[Controller]) -> str:
    numbers = ("step_time_symmetry", "hip_range_symmetry", "interaction_symmetry")
    uneven = [
        f"{item.title} ({', '.join(_side_words(comparison, item, number) for number in uneven_numbers)})"
        for item in walking
        if (uneven_numbers := [n for n in numbers if abs(comparison.interval(item.name, n).mean) > UNEVEN])
    ]
    if not uneven:
        return f"Left and right differ by no more than {100.0 * UNEVEN:.0f} % with any of them."
    return f"Left and right differ by more than {100.0 * UNEVEN:.0f} % with {_list(uneven)}."


def _side_words(comparison: Comparison, controller: Controller, number: str) -> str:
    label = _BY_NUMBER[number].label.partition(",")[0]
    return f"{label} {_shown(comparison, controller, number)} %"


def _battery(comparison: Comparison, walking: Sequence[Controller]) -> str:
    least, most = _extremes(comparison, walking, "battery_life_h")
    hot = [item.title for item in walking if comparison.interval(item.name, "current_rms_share").mean > HOT]
    lives = (
        f"A battery lasts {_shown(comparison, most, 'battery_life_h')} h with {most.title}"
        if least is most
        else f"A battery lasts from {_shown(comparison, least, 'battery_life_h')} h ({least.title}) to "
        f"{_shown(comparison, most, 'battery_life_h')} h ({most.title})"
    )
    if hot:
        return f"{lives}; {_list(hot)} would overheat a motor in the end."
    return f"{lives}; no motor overheats."
