"""Options of built-in agents: defaults, ranges, and one sentence for each bad value."""

import math
from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract.agent_options import Choice, Option, read_choice, read_options
from mdrive_sumo.core.errors import InputError

OPTIONS = {"gap_s": Option(1.5, 0.5, 3.0), "polite": Option(0.0, 0.0, 1.0, is_switch=True)}
CHOICES = {"mode": Choice("calm", ("calm", "brisk"))}


def read(config: Mapping[str, float | str | bool]) -> dict[str, float]:
    return read_options("idm", config, OPTIONS, CHOICES)


def test_what_is_not_given_has_its_default() -> None:
    assert read({}) == {"gap_s": 1.5, "polite": 0.0}
    assert read_choice("idm", {}, "mode", CHOICES["mode"]) == "calm"


@pytest.mark.parametrize(
    ("config", "name", "value"),
    [
        ({"gap_s": 2}, "gap_s", 2.0),
        ({"gap_s": "2.5"}, "gap_s", 2.5),
        ({"gap_s": 0.5}, "gap_s", 0.5),
        ({"gap_s": 3.0, "mode": "brisk"}, "gap_s", 3.0),
        ({"polite": True}, "polite", 1.0),
        ({"polite": False}, "polite", 0.0),
        ({"polite": "1"}, "polite", 1.0),
    ],
)
def test_a_value_in_its_range_is_a_number(config: Mapping[str, float | str | bool], name: str, value: float) -> None:
    number = read(config)[name]
    assert type(number) is float and number == value


@pytest.mark.parametrize(
    ("config", "sentence"),
    [
        ({"gap": 2.0}, "agent idm: expected options among (gap_s, mode, polite), found 'gap'"),
        ({"gap_s": 0.4}, "agent idm: option gap_s: expected a number in [0.5, 3], found 0.4"),
        ({"gap_s": math.nan}, "agent idm: option gap_s: expected a number in [0.5, 3], found nan"),
        ({"gap_s": "wide"}, "agent idm: option gap_s: expected a number in [0.5, 3], found 'wide'"),
        ({"gap_s": True}, "agent idm: option gap_s: expected a number in [0.5, 3], found True"),
        ({"polite": 0.5}, "agent idm: option polite: expected 0 or 1, found 0.5"),
        ({"polite": "yes"}, "agent idm: option polite: expected 0 or 1, found 'yes'"),
    ],
)
def test_a_bad_option_is_one_sentence(config: Mapping[str, float | str | bool], sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        read(config)
    assert str(caught.value) == sentence


def test_an_agent_without_options_says_so() -> None:
    with pytest.raises(InputError, match=r"agent stationary: expected options among \(none\), found 'x'"):
        read_options("stationary", {"x": 1.0}, {})


def test_a_choice_is_among_its_values() -> None:
    assert read_choice("idm", {"mode": "brisk"}, "mode", CHOICES["mode"]) == "brisk"
    for value in ("Brisk", "", 1.0, True):
        with pytest.raises(InputError, match="agent idm: option mode: expected one of calm, brisk, found"):
            read_choice("idm", {"mode": value}, "mode", CHOICES["mode"])


@given(st.one_of(st.floats(), st.booleans(), st.text(max_size=8), st.integers()))
def test_any_value_is_read_within_its_range_or_refused(value: float | str | bool) -> None:
    try:
        number = read({"gap_s": value})["gap_s"]
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert 0.5 <= number <= 3.0
