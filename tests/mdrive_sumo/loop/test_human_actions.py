"""Drivers as notes: what is written is read back, and anything else is one sentence."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import DRIVER, Control, Note
from mdrive_sumo.contract.human_options import DEVICES, HUMAN
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop.human_actions import LIMITS, RECORDING, Action, DriverChoice, make_control

values = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.text(max_size=9), st.booleans())
choices = st.one_of(
    st.sampled_from(DEVICES).map(lambda device: DriverChoice(HUMAN, {"device": device})),
    st.just(DriverChoice(RECORDING)),
    st.builds(
        DriverChoice,
        st.text(min_size=1, max_size=20).filter(lambda name: name not in (HUMAN, RECORDING)),
        st.dictionaries(st.text(max_size=9), values, max_size=3),
    ),
)
anything = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(("driver", "device", "config")), inner),
    max_leaves=8,
)


@given(choices)
def test_a_driver_is_read_as_it_was_written(choice: DriverChoice) -> None:
    note = choice.to_note()
    assert DriverChoice.from_note(note) == choice
    assert DriverChoice.from_note(note).to_note() == note


@given(anything.map(json.dumps) | st.text(max_size=40))
def test_any_note_is_a_driver_or_one_sentence(text: str) -> None:
    try:
        choice = DriverChoice.from_note(Note(DRIVER, text))
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert choice.name
        assert all(isinstance(value, str | int | float) for value in choice.config.values())


@given(st.tuples(*[st.integers(-(2**15), 2**15 - 1)] * 3))
def test_a_recorded_control_is_in_its_range_or_refused(steps: tuple[int, int, int]) -> None:
    are_in_range = all(10_000 * low <= step <= 10_000 for low, step in zip(LIMITS.values(), steps, strict=True))
    try:
        control = make_control(steps)
    except InputError:
        assert not are_in_range
    else:
        assert are_in_range
        assert [round(value * 10_000) for value in (control.throttle, control.brake, control.steer)] == [*steps]


@given(st.floats(), st.floats(), st.floats())
def test_an_action_holds_a_control_that_agents_may_give(throttle: float, brake: float, steer: float) -> None:
    is_valid = 0 <= throttle <= 1 and 0 <= brake <= 1 and -1 <= steer <= 1
    try:
        Action(control=Control(throttle, brake, steer))
    except InputError:
        assert not is_valid
    else:
        assert is_valid


@pytest.mark.parametrize("value", [True, None, "1", [1.0]])
def test_a_control_is_a_number(value: Any) -> None:
    with pytest.raises(InputError, match="brake: expected a number in"):
        Action(control=Control(0.0, value, 0.0))
