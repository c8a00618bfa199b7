"""Requests on a grid of times: an early answer moves nothing, a late one moves by whole paces."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop.request_pace import MAX_PACE_S, RequestPace, make_pace


class Hands:
    """A clock that moves when told, or when somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now_s += seconds


def requests_of(thinking_s: list[float], pace_s: float = 0.25) -> tuple[list[float], int]:
    """When the requests of ticks go out whose agents think so long, and the slips."""
    hands, found = Hands(), list[float]()
    pace = RequestPace(pace_s, lambda: hands.now_s, hands.sleep)
    for seconds in (*thinking_s, 0.0):
        pace.wait()
        found.append(hands.now_s - 100.0)
        hands.now_s += seconds
    return found, pace.slips


def test_early_answers_are_not_seen() -> None:
    for thinking in ([0.0, 0.125, 0.25, 0.0625], [0.25, 0.0, 0.0, 0.0]):
        assert requests_of(thinking) == ([0.0, 0.25, 0.5, 0.75, 1.0], 0)


def test_a_late_answer_is_seen_as_whole_paces() -> None:
    assert requests_of([0.2505, 0.0]) == ([0.0, 0.5, 0.75], 1)
    assert requests_of([0.499, 0.0]) == ([0.0, 0.5, 0.75], 1)
    assert requests_of([0.75, 0.0]) == ([0.0, 0.75, 1.0], 2)


@given(st.lists(st.floats(0.0, 3.0), max_size=30), st.sampled_from([0.25, 0.5, 1.0]))
def test_requests_are_always_on_the_grid(thinking: list[float], pace_s: float) -> None:
    found, slips = requests_of(thinking, pace_s)
    steps = [round(at_s / pace_s, 6) for at_s in found]
    assert all(step == int(step) for step in steps)
    assert steps[-1] == len(thinking) + slips
    assert (slips == 0) == all(seconds <= pace_s for seconds in thinking)


@pytest.mark.parametrize("pace_s", [-0.1, MAX_PACE_S + 0.1, float("nan"), float("inf")])
def test_a_pace_is_a_time(pace_s: float) -> None:
    with pytest.raises(InputError, match="pace: expected more than 0 and at most 1 s, found"):
        make_pace(pace_s)


def test_no_pace() -> None:
    assert make_pace(0.0) is None
