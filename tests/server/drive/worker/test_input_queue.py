"""Inputs of a person: one a tick, in their order; late ones pile up to three, then the newest two are kept."""

from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import Control
from server.drive.worker.input_queue import KEPT, MAX_WAITING, ROLLING, InputQueue


def brake(number: int) -> Control:
    return Control(0.0, number / 1000, 0.0)


def test_without_an_input_the_car_rolls_and_then_the_last_one_is_repeated() -> None:
    queue = InputQueue()
    assert queue.take() == (0, ROLLING)
    queue.put(1, brake(1))
    assert [queue.take(), queue.take()] == [(1, brake(1))] * 2


def test_inputs_are_used_one_a_tick_in_their_order() -> None:
    queue = InputQueue()
    for number in (1, 2, 3):
        queue.put(number, brake(number))
    assert [queue.take()[0] for _ in range(4)] == [1, 2, 3, 3]


def test_of_more_than_three_the_newest_two_are_kept() -> None:
    queue = InputQueue()
    for number in (1, 2, 3, 4):
        queue.put(number, brake(number))
    assert [queue.take()[0] for _ in range(3)] == [3, 4, 4]
    assert (MAX_WAITING, KEPT) == (3, 2)


def test_an_old_number_is_dropped_and_number_one_begins_anew() -> None:
    queue = InputQueue()
    for number in (1, 7, 7, 5):
        queue.put(number, brake(number))
    assert [queue.take()[0] for _ in range(3)] == [1, 7, 7]
    queue.put(1, brake(900))
    assert queue.take() == (1, brake(900))


def test_what_was_pressed_is_released_when_an_agent_drives() -> None:
    queue = InputQueue()
    queue.put(1, brake(1))
    queue.take()
    queue.put(2, brake(2))
    queue.release()
    assert queue.take() == (1, ROLLING)


@given(st.lists(st.one_of(st.integers(2, 60), st.none()), max_size=80))
def test_used_numbers_never_go_back(steps: list[int | None]) -> None:
    """None: a tick; a number: an input arrives."""
    queue, used = InputQueue(), [0]
    for number in steps:
        if number is None:
            used.append(queue.take()[0])
        else:
            queue.put(number, brake(number))
    assert used == sorted(used)
