"""People of one drive: when its clock runs, and what disconnects do."""

from pathlib import Path

import pytest
from testing.drive_bench import Bench, drain, drive, problems, settle

from mdrive_sumo.core.errors import InputError
from server.drive import drive_people
from server.drive.browser_connection import Closing
from server.drive.protocol import FrameState, WireFrame


def test_a_driver_is_welcomed_and_starts_the_clock(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        told = await drain(driver)
        texts = {one["is"]: one for one in told if not isinstance(one, WireFrame)}
        welcome, waiting = texts["welcome"], texts["waiting"]
        assert (welcome["role"], welcome["cav"], welcome["vehicle"]["length"]) == ("driver", "ego_0", 4.9)
        assert welcome["time_limit_ticks"] == dict.fromkeys(("ego_0", "ego_1", "ego_2"), 1200)
        assert welcome["takes"][0]["drivers"] == {"ego_0": "human", "ego_1": "sharing", "ego_2": "sharing"}
        assert (waiting["for"], waiting["absent"]) == (["ego_0"], [])
        frame = next(one for one in told if isinstance(one, WireFrame))
        assert frame.extra is not None
        assert (frame.own[0], frame.extra["signals"], len(frame.extra["names"])) == (0.0, {"J": "rG"}, 2)
        assert bench.clock_calls == []
        await bench.ask(driver, do="resume")
        assert bench.clock_calls == ["resume"]
        told = await bench.ask(driver, do="pause")
        assert bench.clock_calls == ["resume", "pause"]
        assert {"is": "waiting", "for": ["ego_0"], "absent": [], "seconds": None} in told

    drive(test, tmp_path)


def test_the_clock_waits_for_all_drivers(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        first, second = await bench.join("ego_0"), await bench.join("ego_1")
        await bench.ask(first, do="resume")
        assert bench.clock_calls == []
        await bench.ask(second, do="resume")
        assert bench.clock_calls == ["resume"]
        await bench.ask(first, do="pause")
        told = await bench.ask(second, do="resume")
        assert bench.clock_calls == ["resume", "pause"], "a pause of one driver is that driver's"
        assert told == []
        await bench.ask(first, do="resume")
        assert bench.clock_calls == ["resume", "pause", "resume"]

    drive(test, tmp_path, ("ego_0", "ego_1"))


def test_a_driver_whose_cav_has_ended_may_leave(tmp_path: Path) -> None:
    """The others need not wait for it, nor for its start."""

    async def test(bench: Bench) -> None:
        first, second = await bench.join("ego_0"), await bench.join("ego_1")
        await bench.ask(first, do="resume")
        await bench.ask(second, do="resume")
        bench.simulation.step(endings={"ego_0": "arrived"})
        await settle()
        bench.session.disconnect(first)
        await settle()
        assert bench.clock_calls == ["resume"]
        bench.session.disconnect(second)
        await settle()
        assert bench.clock_calls == ["resume", "pause"]

    drive(test, tmp_path, ("ego_0", "ego_1"))


def test_who_had_arrived_before_going_back_is_waited_for(tmp_path: Path) -> None:
    """Also while the first frame of the branch is on its way."""

    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        await bench.ask(driver, do="resume")
        bench.simulation.step(endings={"ego_0": "arrived"})
        await settle()
        bench.simulation.emit_frame(FrameState.FINISHED)
        await settle()
        emit, late = bench.simulation.emit, []
        bench.simulation.emit = lambda *events: late.extend(events)
        await bench.ask(driver, do="rewind", take=1, tick=0)
        bench.simulation.emit = emit
        for event in late:
            emit(event)
            await settle()
            await bench.wait(1.0, driver)
        assert bench.clock_calls == ["resume"]
        await bench.ask(driver, do="resume")
        assert bench.clock_calls == ["resume", "resume"]

    drive(test, tmp_path, ("ego_0",))


def test_a_lost_driver_pauses_and_goes_on_within_a_minute(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver, watcher = await bench.join("ego_0"), await bench.join()
        await bench.ask(driver, do="resume")
        bench.session.disconnect(driver)
        await settle()
        assert bench.clock_calls == ["resume", "pause"]
        told = await drain(watcher)
        assert {"is": "notice", "text": "CAV ego_0: its driver is gone"} in told
        assert {"is": "waiting", "for": ["ego_0"], "absent": ["ego_0"], "seconds": 60.0} in told
        await bench.wait(59.0)
        back = await bench.join("ego_0")
        assert bench.clock_calls == ["resume", "pause", "resume"]
        assert (await drain(back))[0]["is"] == "welcome"

    drive(test, tmp_path)


def test_after_a_minute_the_driver_must_press_start_again(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver, other = await bench.join("ego_0"), await bench.join("ego_1")
        await bench.ask(driver, do="resume")
        await bench.ask(other, do="resume")
        refused = await bench.ask(other, do="hand-over", cav="ego_0", to="idm")
        assert "hand-over: cav: expected your own or one whose driver has not come back" in problems(refused)[0]
        bench.session.disconnect(driver)
        await bench.wait(61.0, other)
        assert await bench.ask(other, do="hand-over", cav="ego_0", to="idm")
        assert ("hand_over", "ego_0", "idm", {}) in bench.simulation.calls
        assert bench.clock_calls == ["resume", "pause", "resume"], "the agent drives, so the clock waits no longer"
        await bench.join("ego_0")
        assert bench.clock_calls[-1] == "pause"

    drive(test, tmp_path, ("ego_0", "ego_1"))


def test_an_agent_stands_in_for_a_lost_driver(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        await bench.ask(driver, do="resume")
        bench.session.disconnect(driver)
        await settle()
        assert bench.simulation.calls[-1] == ("hand_over", "ego_0", "idm", {})
        await bench.wait(10.0)
        assert bench.clock_calls == ["resume"], "the clock does not stop"
        await bench.join("ego_0")
        assert bench.simulation.calls[-1] == ("hand_over", "ego_0", "human", {"device": "keyboard"})
        assert bench.clock_calls == ["resume"]

    drive(test, tmp_path, on_disconnect="idm")


def test_a_silent_driver_stops_the_clock_and_speaking_starts_it(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        await bench.ask(driver, do="resume")
        await bench.wait(drive_people.SILENCE_S + 0.1)
        assert bench.clock_calls == ["resume", "pause"]
        await bench.ask(driver, do="ping", time=1)
        await bench.wait(0.1)
        assert bench.clock_calls == ["resume", "pause", "resume"]

    drive(test, tmp_path)


def test_a_second_driver_is_refused_and_a_silent_one_makes_room(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        first = await bench.join("ego_0")
        with pytest.raises(InputError, match=r"^ego_0: expected a free seat, found a driver at the wheel; a spectator"):
            await bench.join("ego_0")
        await bench.wait(drive_people.SILENCE_S + 0.1)
        second = await bench.join("ego_0")
        assert (await drain(first))[-1] == Closing(1008, "the driver has connected anew")
        bench.session.disconnect(first)
        await settle()
        assert bench.session.people.seats["ego_0"].connection is second, "the old one leaves nothing behind"

    drive(test, tmp_path)


def test_the_end_of_the_simulation_closes_connections(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        bench.simulation.end()
        await settle()
        told = await drain(driver)
        assert problems(told) == ["the simulation of this drive has ended"]
        assert told[-1] == Closing(1001, "the simulation has ended")
        with pytest.raises(InputError, match="the simulation of this drive has ended"):
            await bench.join()

    drive(test, tmp_path)
