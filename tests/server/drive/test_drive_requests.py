"""What browsers of a drive send and get: inputs, requests, frames, floods."""

from pathlib import Path
from typing import Any

import pytest
from testing.drive_bench import Bench, drain, drive, problems, settle

from mdrive_sumo.contract import Control
from server.drive.browser_connection import Closing
from server.drive.messages import TreeOut, WaitingOut
from server.drive.protocol import DriveInput, InputDevice, WireFrame, encode_input
from server.drive.simulation_values import TreeChanged
from server.drive.take_tree import DriverChange


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
        await bench.ask(driver, do="rewind", take=1, tick=0)  # its parent may have been driven with another one
        await bench.session.receive(driver, encode_input(DriveInput(InputDevice.WHEEL, 4, 0.0, Control(0, 0, 0))))
        await settle()
        assert bench.simulation.calls[-1] == noted[0]

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
        assert {"is": "notice", "text": "CAV ego_0: its driver went back to 0.0 s of take 1"} in told
        (tree, *_) = [one for one in told if isinstance(one, dict) and one["is"] == "tree"]
        assert [(take["number"], take["parent"]) for take in tree["takes"]] == [(1, None), (2, 1)]
        assert [one.take for one in told if isinstance(one, WireFrame)][-1] == 2
        await bench.ask(first, do="resume")
        assert bench.clock_calls == ["resume"]
        await bench.ask(second, do="resume")
        assert bench.clock_calls == ["resume", "resume"]

    drive(test, tmp_path, ("ego_0", "ego_1"))


def test_the_tree_tells_who_drove_from_which_tick_on(tmp_path: Path) -> None:
    async def test(bench: Bench) -> None:
        driver = await bench.join("ego_0")
        await drain(driver)
        tree = bench.simulation.fake_tree
        take = tree.find(1).with_changes([DriverChange(7, "ego_0", "idm")])
        bench.simulation.emit(TreeChanged(tree.with_take(take)))
        bench.simulation._tree = tree.with_take(take)
        await settle()
        (told,) = await drain(driver)
        (shown,) = told["takes"]
        assert shown["changes"] == [{"tick": 7, "cav": "ego_0", "driver": "idm"}]
        assert (shown["drivers"]["ego_0"], shown["left_tick"]) == ("human", None)

    drive(test, tmp_path)


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
        walker, wall = ({"cav": "ego_0", "with": word, "id": ""} for word in ("pedestrian", "wall"))
        bench.simulation.step(signals={"J": "Gr"}, messages=MESSAGES, collisions=[walker])
        bench.simulation.step(names=[more], signals={"K": "r"}, factor=0.8)
        bench.simulation.step(messages=MESSAGES[1:], collisions=[wall], endings={"ego_1": "arrived"})
        await settle()
        (frame,) = await drain(driver)
        assert frame.tick == 3
        assert frame.extra == {
            "signals": {"J": "Gr", "K": "r"},
            "names": [more],
            "messages": [*MESSAGES, MESSAGES[1]],
            "collisions": [walker, wall],
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


def test_only_the_newest_tree_waits_for_a_browser_that_does_not_read(tmp_path: Path) -> None:
    """A tree of many takes has some hundred kilobytes, and changes with every take that is finished."""

    async def test(bench: Bench) -> None:
        watcher = await bench.join()
        await drain(watcher)
        for number in range(1, 301):
            watcher.put(TreeOut(takes=[], current=number))
            watcher.put(WaitingOut(waits_for=["ego_0"], absent=[], seconds=float(number)))
        watcher.put_problem("one sentence")
        told = await drain(watcher)
        assert [one["is"] for one in told] == ["problem", "tree", "waiting"]
        assert (told[1]["current"], told[2]["seconds"]) == (300, 300.0)
        assert not watcher.is_closing

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
