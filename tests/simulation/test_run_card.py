"""What a notebook shows of a run."""

from dataclasses import replace
from html.parser import HTMLParser

from twin_gait import load_experiment, simulate


def test_the_card_of_a_run_states_its_outcome_and_escapes_names():
    run = simulate(load_experiment("bench_leg", ["duration_s=0.5"]).experiment)
    named = replace(run, experiment=replace(run.experiment, name="<b>mine"))
    card = named._repr_html_()
    assert "&lt;b&gt;mine" in card and "<b>mine" not in card
    assert "0.5 s" in card and f"{run.log.shape[1]} columns" in card
    parser = HTMLParser()
    parser.feed(card)
    assert len(card) < 1000
