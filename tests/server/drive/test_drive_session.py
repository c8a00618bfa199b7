"""People of one drive: when its clock runs, what disconnects do, what each of them may ask for."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from testing.drive_fakes import FakeSimulation, make_setup

from mdrive_sumo.contract import Control
from mdrive_sumo.core.errors import InputError
from server.drive import drive_people
from server.drive.access import Seat, SeatRole
from server.drive.browser_connection import BrowserConnection, Closing
from server.drive.drive_session import DriveSession
from server.drive.protocol import DriveInput, InputDevice, WireFrame, decode_frame, encode_input
from server.drive.session_rules import SessionRules


class Bench:
    """A session over a fake simulation, with a clock that tests set."""

    def __init__(self, folder: Path, people: tuple[str, ...], rules: SessionRules) -> None:
        self.now_s = 100.0
        self.folder, self.people, self.rules = folder, people, rules
        self.simulation = FakeSimulation()

    async def start(self) -> None:
        await self.simulation.open(make_setup(self.folder, self.people))
        self.session = DriveSession("drive", self.simulation, self.rules, lambda: self.now_s)
        self.running = asyncio.create_task(self.session.run())
        await settle()

    async def join(self, cav: str = "") -> BrowserConnection:
        role = SeatRole.DRIVER if cav else SeatRole.SPECTATOR
        connection = self.session.connect(Seat("drive", role, cav))
        await settle()
        return connection

    async def ask(self, connection: BrowserConnection, **request: Any) -> list[Any]:
        """Send a request, and return what the browser is told then."""
        await drain(connection)
        await self.session.receive(connection, json.dumps(request))
        await settle()
        return await drain(connection)

    async def wait(self, seconds: float, *present: BrowserConnection) -> None:
        """Let time pass; those who are present are heard."""
        self.now_s += seconds
        for connection in present:
            connection.heard_s = self.now_s
        await self.session.update_clock()
        await settle()

    @property
    def clock_calls(self) -> list[str]:
        return [call[0] for call in self.simulation.calls if call[0] in ("pause", "resume")]


async def settle() -> None:
    for _ in range(20):
        await asyncio.sleep(0)


async def drain(connection: BrowserConnection) -> list[Any]:
    """What waits for a browser: messages as objects, frames as `WireFrame`s."""
    out: list[Any] = []
    while True:
        try:
            sent = await asyncio.wait_for(connection.take_next(), 0.005)
        except TimeoutError:
            return out
        if isinstance(sent, Closing):
            return [*out, sent]
        out += [decode_frame(one) if isinstance(one, bytes) else json.loads(one) for one in sent]


def problems(told: list[Any]) -> list[str]:
    return [one["text"] for one in told if isinstance(one, dict) and one["is"] == "problem"]


def drive(
    test: Callable[[Bench], Awaitable[None]], folder: Path, people: tuple[str, ...] = ("ego_0",), **rules: Any
) -> None:
    async def run() -> None:
        bench = Bench(folder, people, SessionRules(**rules))
        await bench.start()
        await test(bench)
        bench.simulation.end()
        await bench.running

    asyncio.run(run())


def test_a_driver_is_welcomed_and_starts_the_clock(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        welcome, waiting, *_, frame = [
            one for one in await drain(driver) if isinstance(one, WireFrame) or one["is"] in ("welcome", "waiting")
        ]
        assert (welcome["role"], welcome["cav"], welcome["vehicle"]["length"]) == ("driver", "ego_0", 4.9)
        assert welcome["takes"][0]["drivers"] == {"ego_0": "human", "ego_1": "sharing", "ego_2": "sharing"}
        assert (waiting["for"], waiting["absent"]) == (["ego_0"], [])
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


def test_a_lost_driver_pauses_and_goes_on_within_a_minute(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver, watcher = await bench.join("ego_0"), await bench.join()
        await bench.ask(driver, do="resume")
        bench.session.disconnect(driver)
        await settle()
        assert bench.clock_calls == ["resume", "pause"]
        told = await drain(watcher)
        assert {"is": "notice", "text": "ego_0: its driver is gone"} in told
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


def test_inputs_reach_the_simulation_and_wrong_ones_do_not(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver, watcher = await bench.join("ego_0"), await bench.join()
        control = Control(0.5, 0.0, 0.25)
        await bench.session.receive(driver, encode_input(DriveInput(InputDevice.KEYBOARD, 1, 0.0, control)))
        assert bench.simulation.inputs == [("ego_0", 1, control)]
        await drain(driver)
        for number, message, sentence in (
            (1, None, "input: number: expected more than 1, found 1"),
            (2, b"\x02\x00", "input: expected 28 bytes, found 2"),
        ):
            given = message or encode_input(DriveInput(InputDevice.KEYBOARD, number, 0.0, control))
            await bench.session.receive(driver, given)
            assert problems(await drain(driver)) == [sentence]
        await bench.session.receive(watcher, encode_input(DriveInput(InputDevice.KEYBOARD, 1, 0.0, control)))
        assert problems(await drain(watcher)) == ["input: expected one of a driver, found a spectator's"]
        await bench.ask(driver, do="hand-over", cav="ego_0", to="idm")
        await bench.session.receive(driver, encode_input(DriveInput(InputDevice.KEYBOARD, 9, 0.0, control)))
        assert len(bench.simulation.inputs) == 1, "an agent drives"
        assert problems(await drain(driver)) == []

    drive(test, tmp_path)


def test_a_new_device_is_noted(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        for number, device in enumerate((InputDevice.KEYBOARD, InputDevice.WHEEL, InputDevice.WHEEL), 1):
            await bench.session.receive(driver, encode_input(DriveInput(device, number, 0.0, Control(0, 0, 0))))
            await settle()
        noted = [call for call in bench.simulation.calls if call[0] == "hand_over"]
        assert noted == [("hand_over", "ego_0", "human", {"device": "wheel"})]

    drive(test, tmp_path)


@pytest.mark.parametrize(
    ("request_", "rules", "sentence"),
    [
        ({"do": "pause"}, {"may_pause": False}, "pause: this drive cannot be paused"),
        (
            {"do": "rewind", "take": 1, "tick": 0},
            {"may_rewind": False},
            "rewind: this drive goes on without going back",
        ),
        ({"do": "rewind", "take": 7, "tick": 0}, {}, "take: expected one of this drive (1 to 1), found 7"),
        (
            {"do": "what-if", "take": 1, "tick": 0, "agents": ["idm"]},
            {"may_rewind": False},
            "what-if: this drive goes on without going back",
        ),
        ({"do": "say", "text": "hi"}, {"chat": False}, "say: this drive is without chat"),
        (
            {"do": "hand-over", "cav": "ego_0", "to": "idn"},
            {},
            "hand-over: to: expected one of human, sharing, idm, found 'idn'; did you mean 'idm'?",
        ),
        (
            {"do": "hand-over", "cav": "ego_1", "to": "idm"},
            {},
            "hand-over: cav: expected your own or one whose driver has not come back, found 'ego_1'",
        ),
        (
            {"do": "hand-over", "cav": "ego_0", "to": "idm"},
            {"may_hand_over": False},
            "hand-over: people drive this drive to its end",
        ),
        (
            {"do": "halt"},
            {},
            "message: do: expected one of pause, resume, finish, leave, rewind, hand-over, say, what-if,",
        ),
    ],
)
def test_what_cannot_be_done_costs_one_sentence(
    request_: dict[str, Any], rules: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        (problem,) = problems(await bench.ask(driver, **request_))
        assert problem.startswith(sentence)

    drive(test, tmp_path, **rules)


def test_spectators_ask_for_nothing_but_pongs(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        watcher = await bench.join()
        assert problems(await bench.ask(watcher, do="resume")) == [
            "resume: expected a driver's link, found a spectator's"
        ]
        assert await bench.ask(watcher, do="ping", time=7.5) == [{"is": "pong", "time": 7.5}]

    drive(test, tmp_path)


def test_a_rewind_makes_a_branch_and_waits_for_all(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        first, second = await bench.join("ego_0"), await bench.join("ego_1")
        for connection in (first, second):
            await bench.ask(connection, do="resume")
        bench.simulation.step()
        await bench.ask(first, do="rewind", take=1, tick=0)
        assert ("branch", 1, 0) in bench.simulation.calls
        told = await drain(second)
        assert {"is": "notice", "text": "ego_0: its driver went back to 0.0 s of take 1"} in told
        (tree, *_) = [one for one in told if isinstance(one, dict) and one["is"] == "tree"]
        assert [(take["number"], take["parent"]) for take in tree["takes"]] == [(1, None), (2, 1)]
        assert [one.take for one in told if isinstance(one, WireFrame)][-1] == 2
        await bench.ask(first, do="resume")
        assert bench.clock_calls == ["resume"]
        await bench.ask(second, do="resume")
        assert bench.clock_calls == ["resume", "resume"]

    drive(test, tmp_path, ("ego_0", "ego_1"))


def test_a_finished_take_is_not_resumed(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        await bench.ask(driver, do="finish")
        (problem,) = problems(await bench.ask(driver, do="resume"))
        assert problem == "resume: expected a take that goes on, found a finished one; go back to a tick to branch"
        assert problems(await bench.ask(driver, do="finish")) == [
            "finish: expected a take that goes on, found a finished one"
        ]
        assert bench.clock_calls == []

    drive(test, tmp_path)


def test_what_if_answers_with_ghosts_to_who_asked(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        first, second = await bench.join("ego_0"), await bench.join("ego_1")
        await drain(second)
        (ghosts,) = await bench.ask(first, do="what-if", take=1, tick=3, agents=["idm", "sharing"], seconds=2)
        assert ghosts["is"] == "ghosts"
        assert [ghost["agent"] for ghost in ghosts["ghosts"]] == ["idm", "sharing"]
        assert ghosts["ghosts"][0]["poses"] == [[1.0, 2.0, 0.5]]
        assert bench.simulation.calls[-1] == ("what_if", 1, 3, ("idm", "sharing"), 2.0, ("ego_0",))
        assert await drain(second) == []

    drive(test, tmp_path, ("ego_0", "ego_1"))


MESSAGES = [
    {"kind": "cam", "from": "p1", "to": ["ego_0"]},
    {"kind": "text", "from": "p1", "to": ["ego_0", "ego_1"], "text": "I yield"},
]


@pytest.mark.parametrize(
    ("rules", "shown"),
    [
        ({}, ["cam", "text"]),
        ({"v2x_view": False}, ["text"]),
        ({"chat": False}, ["cam"]),
        ({"chat": False, "v2x_view": False}, []),
    ],
)
def test_drivers_see_what_their_car_receives_and_their_condition_shows(
    rules: dict[str, bool], shown: list[str], tmp_path: Path
) -> None:
    async def test(bench: Bench) -> None:
        first, second, watcher = await bench.join("ego_0"), await bench.join("ego_1"), await bench.join()
        for connection in (first, second, watcher):
            await drain(connection)
        bench.simulation.step(messages=MESSAGES)
        await settle()
        seen = [
            [one["kind"] for one in (await drain(connection))[-1].extra.get("messages", [])]
            for connection in (first, second, watcher)
        ]
        assert seen == [shown, [kind for kind in shown if kind == "text"], shown]

    drive(test, tmp_path, ("ego_0", "ego_1"), **rules)


def test_a_slow_browser_misses_frames_and_nothing_new(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        await drain(driver)
        more = [2, "new", "vehicle", 4.0, 2.0, 1.5, "car", [0, 0, 0]]
        bench.simulation.step(signals={"J": "Gr"}, messages=MESSAGES)
        bench.simulation.step(names=[more], signals={"K": "r"}, factor=0.8)
        bench.simulation.step(messages=MESSAGES[1:], endings={"ego_1": "arrived"})
        await settle()
        (frame,) = await drain(driver)
        assert frame.tick == 3
        assert frame.extra == {
            "signals": {"J": "Gr", "K": "r"},
            "names": [more],
            "messages": [*MESSAGES, MESSAGES[1]],
            "factor": 0.8,
            "endings": {"ego_1": "arrived"},
        }

    drive(test, tmp_path)


def test_floods_are_dropped_with_a_word_and_then_closed(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        await drain(driver)
        for _ in range(60):
            await bench.session.receive(driver, '{"do":"say","text":"x"}')
        assert len([call for call in bench.simulation.calls if call[0] == "say"]) == 40
        assert problems(await drain(driver)) == ["expected at most 20 messages a second; those beyond are dropped"]
        for number in range(300):
            await bench.session.receive(
                driver, encode_input(DriveInput(InputDevice.SCRIPT, number + 1, 0.0, Control(0, 0, 0)))
            )
        assert len(bench.simulation.inputs) == 240
        for _ in range(700):
            await bench.session.receive(driver, '{"do":"resume"}')
        assert (await drain(driver))[-1] == Closing(1008, "too many messages")

    drive(test, tmp_path)


def test_a_browser_that_reads_nothing_is_closed(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        watcher = await bench.join()
        for _ in range(300):
            watcher.put_problem("x")
        assert watcher.is_closing

    drive(test, tmp_path)


def test_a_clock_that_cannot_start_is_not_tried_again_and_again(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        bench.simulation.refusal = "take 1: cannot be written: no space left on device"
        assert problems(await bench.ask(driver, do="resume")) == [bench.simulation.refusal]
        await bench.wait(1.0, driver)
        await bench.wait(1.0, driver)
        assert problems(await drain(driver)) == []

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
