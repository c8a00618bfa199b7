"""The clock of a drive in fake time: no tick is skipped, short delays are caught up, long ones slow the drive down."""

import pytest

from server.drive.worker.tick_clock import MAX_CATCH_UP_S, TickClock


class FakeTime:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def run_ticks(clock: TickClock, time: FakeTime, durations_s: list[float]) -> list[float]:
    """Wait for each tick, begin it, and let it take its time; return when the ticks began."""
    begun: list[float] = []
    for duration_s in durations_s:
        time.now_s += clock.wait_s
        begun.append(round(time.now_s - 100.0, 6))
        clock.begin_tick()
        time.now_s += duration_s
    return begun


def test_ticks_are_on_a_grid_of_50_ms() -> None:
    time = FakeTime()
    assert run_ticks(TickClock(1.0, time), time, [0.01, 0.049, 0.0, 0.05]) == [0.0, 0.05, 0.1, 0.15]


def test_a_short_delay_is_caught_up_and_a_long_one_moves_the_grid() -> None:
    time = FakeTime()
    clock = TickClock(1.0, time)
    assert run_ticks(clock, time, [0.08, 0.0, 0.0]) == [0.0, 0.08, 0.1]  # 30 ms late, then on the grid again
    begun = run_ticks(clock, time, [1.0, 0.0, 0.0, 0.0, 0.0])
    assert begun == [0.15, 1.15, 1.15, 1.15, 1.2]  # two ticks at once, no more, and none is skipped
    assert MAX_CATCH_UP_S == 0.1


def test_a_machine_that_cannot_keep_up_slows_the_drive_down_and_says_so() -> None:
    time = FakeTime()
    clock = TickClock(1.0, time)
    assert clock.factor == 1.0
    run_ticks(clock, time, [0.01] * 60)
    assert clock.factor == pytest.approx(1.0)
    assert not clock.is_slow
    begun = run_ticks(clock, time, [0.1] * 60)
    assert clock.factor == pytest.approx(0.5)
    assert clock.is_slow
    assert begun[-1] - begun[-2] == pytest.approx(0.1)
    run_ticks(clock, time, [0.01] * 60)
    assert not clock.is_slow


def test_one_hiccup_is_no_slow_machine() -> None:
    time = FakeTime()
    clock = TickClock(1.0, time)
    run_ticks(clock, time, [0.01] * 60)
    run_ticks(clock, time, [0.12])
    for _ in range(60):
        run_ticks(clock, time, [0.01])
        assert not clock.is_slow


def test_a_pause_is_no_delay() -> None:
    time = FakeTime()
    clock = TickClock(1.0, time)
    run_ticks(clock, time, [0.01] * 60)
    time.now_s += 30.0
    clock.start()
    assert clock.wait_s == 0.0
    first, second = run_ticks(clock, time, [0.01, 0.01])
    assert second - first == pytest.approx(0.05)
    assert clock.factor == pytest.approx(1.0)


def test_programs_drive_faster_than_real_time() -> None:
    time = FakeTime()
    assert run_ticks(TickClock(5.0, time), time, [0.0, 0.0, 0.0]) == [0.0, 0.01, 0.02]
