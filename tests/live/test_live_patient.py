"""Sessions of a physiotherapist in Chromium: named patient, two changes, stop, report, and the next day."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from errors import states
from test_live_browser import Page, Walk, browser, until

__all__ = ["browser"]  # a fixture

pytestmark = [pytest.mark.slow, pytest.mark.browser]

CONDITION = 11.0  # [s]: two strides settle, and three count


def treat(
    browser: Any, walk: Walk, speed: float, stiffness: float, patient: str, printed: Path
) -> tuple[str, str]:
    """Make two changes, save the settings, stop and print; return the saved file and text of the report."""
    page = Page(browser, walk, draws=False)
    page.wait(CONDITION)
    page.type("belt_speed", speed)
    assert page.refusal("belt_speed") == ""
    page.wait(CONDITION)
    page.tab("table")
    page.page.click('.chip[data-phase="late_stance"]')
    page.type("late_stance.hip.stiffness", stiffness)
    assert page.refusal("late_stance.hip.stiffness") == ""
    page.wait(CONDITION)
    page.tab("walk")
    name = page.row("patient").locator("input")
    # On a busy machine the page may be without data for a moment; its inputs then take no text.
    until(lambda: (name.fill(patient), name.input_value() == patient)[1], "the name")
    page.page.click("[data-action=save_settings]")
    saved = page.page.locator("fieldset:has([data-action=save_settings]) > .rejection.done")
    until(saved.is_visible, "the saved settings")
    file = re.search(r"twin-gait live (\S+)", saved.inner_text())[1]
    link = page.page.locator("#session-report")
    assert not link.is_visible()  # while the wearer walks
    page.page.click("#stop")
    until(lambda: page.status() == "held" and link.is_visible(), "the report")
    with page.page.context.expect_page(timeout=300_000.0) as opened:
        link.click()
    report = opened.value
    report.wait_for_load_state()
    text = report.locator("body").inner_text()
    report.pdf(path=printed, prefer_css_page_size=True)
    report.close()
    page.close()
    walk.end()
    return file, text


def test_two_sessions_of_a_patient_and_their_reports(browser: Any, tmp_path: Path) -> None:
    person = ["--patient", "stroke_left", "--mass", "62", "--height", "1.68"]
    file, first = treat(browser, Walk(tmp_path, *person, name="day1"), 1.8, 1.9, "P03", tmp_path / "day1.pdf")
    assert states(first, "P03, 62 kg, 1.68 m", "1.50 km/h", "1.80 km/h", "1.90 N·m/°", "emergency stop")
    assert "no earlier session" in first
    _, second = treat(browser, Walk(tmp_path, file, name="day2"), 1.7, 1.6, "P03", tmp_path / "day2.pdf")
    assert states(second, "P03, 62 kg, 1.68 m", "1.70 km/h", "1.60 N·m/°", "last session", "number 1")
    assert "began with the settings at its end" in second
    assert "strides, left and right" in second and (tmp_path / "day2-report.html").is_file()
    for day in ("day1", "day2"):
        content = (tmp_path / f"{day}.pdf").read_bytes()
        assert len(re.findall(rb"/Type\s*/Page[^s]", content)) == 1
