"""Several people over the real simulation: lost connections, a killed server, and `--resume`; nothing is lost."""

import json
from pathlib import Path

import pytest
from testing.drive_client import DriveClient, play_until
from testing.drive_command import drive_folder, run_command, run_drive

from server.drive.protocol import FrameState

pytestmark = pytest.mark.slow


@pytest.mark.full
def test_two_people_a_lost_one_a_killed_server_and_the_way_back(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    with run_drive("i11_ins_sl_town", "--cav", 0, "--cav", 1, "--out", folder) as command:  # noqa: SIM117
        with DriveClient(command.links["0"]) as first, DriveClient(command.links["spectators"]) as watcher:
            second = DriveClient(command.links["1"])
            first.ask(do="resume")
            play_until(lambda: first.tell("waiting").get("for") == ["1"], first, second, watcher)
            assert first.tick == 0, "the clock waits for both"
            second.ask(do="resume")
            play_until(lambda: min(first.tick, second.tick, watcher.tick) >= 20, first, second, watcher)
            assert abs(first.tick - second.tick) <= 2, "in lock-step"

            second.leave()
            play_until(lambda: first.tell("waiting")["absent"] == ["1"], first, watcher)
            play_until(lambda: first.state == FrameState.PAUSED, first, watcher)
            assert 55 <= first.tell("waiting")["seconds"] <= 60
            stood = first.tick
            with DriveClient(command.links["1"]) as again:
                play_until(lambda: first.tick >= stood + 10, first, again, watcher)
                again.ask(do="say", text="I am back")
                play_until(lambda: "messages" in (first.frame.extra or {}) if first.frame else False, first, again)
                command.kill()
                first.receive_rest()
                last = first.tick
    with run_drive("--resume", folder) as command, DriveClient(command.links["0"]) as first:
        with DriveClient(command.links["1"]) as second:
            play_until(lambda: first.tick >= 0, first, second)
            assert first.frame is not None
            assert first.frame.take == 2
            assert last - 3 <= first.tick <= last + 2, "the new take begins where the killed server stood"
            first.ask(do="resume")
            second.ask(do="resume")
            begun = first.tick
            play_until(lambda: first.tick >= begun + 10, first, second)
            first.ask(do="finish")
            play_until(lambda: all(take["score"] is not None for take in first.takes), first, second)
        said = command.stop()
    assert f"mdrive-sumo drive --resume {folder}" in said
    tree = json.loads((folder / "tree.json").read_text())
    assert [(take["number"], take["parent"], take["status"]) for take in tree["takes"]] == [
        (1, None, "finished"),
        (2, 1, "finished"),
    ]
    for number in (1, 2):
        assert "i11_ins_sl_town: identical" in run_command("verify", drive_folder(folder, number))
