"""Colours of traffic lights by tick."""

from dataclasses import replace

import pytest
from testing.viewer_crossing import record

from mdrive_sumo.episode.episode import SignalEntry
from mdrive_sumo.report.palette import LIGHT
from mdrive_sumo.report.render.rendered_episode import SignalStates

CHANGES = (SignalEntry(3, "c", "rG"), SignalEntry(10, "c", "yo"), SignalEntry(5, "d:x", "g"))


@pytest.mark.parametrize(
    ("light", "tick", "colour"),
    [
        ("c:0", 2, "muted"),  # before the first change
        ("c:0", 3, "bad"),
        ("c:1", 9, "good"),
        ("c:0", 10, "warn"),
        ("c:1", 99, "muted"),  # off
        ("c:7", 9, "muted"),  # a light that the state does not have
        ("d:x:0", 5, "good"),
        ("nothing:0", 5, "muted"),
    ],
)
def test_a_light_has_the_colour_of_its_letter(light: str, tick: int, colour: str) -> None:
    states = SignalStates(replace(record(ticks=4), signals=CHANGES))
    assert states.find_colour(light, tick) == LIGHT[colour]
