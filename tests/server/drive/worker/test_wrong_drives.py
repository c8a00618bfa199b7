"""Wrong setups, calls and folders cost one sentence each."""

from pathlib import Path
from shutil import copyfile, copytree

import pytest
from testing.drives import DriveSession, make_setup, run_drive

from mdrive_sumo.contract import Control
from mdrive_sumo.core.clock import parse_clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode.episode_options import EpisodeOptions
from server.drive.worker.drive_context import load_context
from server.drive.worker.drive_folder import lock_folder

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]


def test_bad_calls_cost_one_sentence_and_the_drive_goes_on(suite: Path, tmp_path: Path) -> None:
    async def drive(session: DriveSession) -> None:
        process = session.process
        await session.open(make_setup(tmp_path / "drive", suite))
        await session.drive_to(10)
        last = session.tick
        for take, tick, sentence in (
            (7, 0, "take: expected one of this drive"),
            (1, last + 1, f"tick: expected one of take 1, 0 to {last}, found {last + 1}"),
            (1, -1, "tick: expected one of take 1"),
            (1, 1.5, "tick: expected one of take 1"),
        ):
            with pytest.raises(InputError, match=sentence):
                await process.branch(take, tick)  # pyright: ignore[reportArgumentType]
        for control in (Control(float("nan"), 0.0, 0.0), Control(0.0, 2.0, 0.0), Control(0.0, 0.0, float("inf"))):
            with pytest.raises(InputError, match="input: "):
                process.put_input("0", 1, control)
        with pytest.raises(InputError, match="input: expected a CAV"):
            process.put_input("9", 1, Control(0.0, 0.0, 0.0))
        with pytest.raises(InputError, match="what-if: expected 1 to 32 agents, found 33"):
            await process.what_if(1, 5, ["sharing"] * 33)
        with pytest.raises(InputError, match="what-if: expected more than 0"):
            await process.what_if(1, 5, ["sharing"], float("nan"))
        with pytest.raises(InputError, match="expected a driver among"):
            await process.what_if(1, 5, ["omniscient"])
        with pytest.raises(InputError, match="take: expected one of this drive"):
            await process.load_motion(4)
        await session.drive_to(20)
        assert session.tick >= 20
        await process.leave()
        with pytest.raises(InputError, match="resume: expected a take that goes on"):
            await process.resume()
        await process.pause()  # void
        await process.branch(1, 15)
        await session.drive_to(18)

    run_drive(drive)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"people": ("9",)}, "CAV: expected one of 0, 1, found '9'"),
        ({"people": ("0", "0")}, "expected each once"),
        ({"others": "nothing"}, "expected built-in agents"),
        ({"others": "idm"}, "option substitutes: expected agents that need no other sensor than is on board, found"),
        ({"others": "colmdriver"}, "expected agents without a language model"),
        ({"suite": "/nowhere"}, "/nowhere"),
        ({"weather": "hail"}, "weather: expected one of"),
        ({"options": EpisodeOptions(clock=parse_clock("measured"))}, "agent clock: expected ideal, found measured"),
        ({"tick_limit_s": 0.0}, "tick_limit_s: expected up to 3600 s, found 0.0"),
        ({"checkpoint_s": -1.0}, "checkpoint_s: expected 0 to 60"),
        ({"speed_up": 0.5}, "speed_up: expected 1 to 1000"),
        ({"from_run": Path("/nowhere")}, "nowhere"),
    ],
)
def test_a_wrong_setup_costs_one_sentence(
    suite: Path, tmp_path: Path, values: dict[str, object], sentence: str
) -> None:
    with pytest.raises(InputError) as caught:
        load_context(make_setup(tmp_path / "drive", suite, **values))
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "drive").exists()


@pytest.fixture(scope="module")
def short_drive(suite: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a drive that ended in its first ticks; tests change copies of it."""
    folder = tmp_path_factory.mktemp("short") / "drive"

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite))
        await session.drive_to(3)

    run_drive(drive)
    return folder


@pytest.mark.full
def test_folders_that_are_no_place_for_this_drive_cost_one_sentence(suite: Path, tmp_path: Path) -> None:
    async def leave_one(session: DriveSession) -> None:
        await session.open(make_setup(tmp_path / "drive", suite))
        await session.drive_to(5)
        await session.close()

    run_drive(leave_one)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").write_text("mine")
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "tree.json").write_text("{")
    for name, values, sentence in (
        ("drive", {"seed": 3}, "expected a drive with seed 3, found one with 0; choose another folder"),
        ("other", {}, "expected a new or empty folder"),
        ("torn", {}, "tree.json: expected JSON"),
    ):

        async def drive(session: DriveSession, name: str = name, values: dict[str, object] = values) -> None:
            await session.open(make_setup(tmp_path / name, suite, **values))

        with pytest.raises(InputError, match=sentence):
            run_drive(drive)


@pytest.mark.full
def test_a_folder_in_which_another_drive_goes_on_costs_one_sentence(suite: Path, tmp_path: Path) -> None:
    """Both would give their next take the same number. The lock ends with the last process of the first drive."""
    setup = make_setup(tmp_path / "drive", suite)

    async def drive(session: DriveSession) -> None:
        await session.open(setup)
        await session.drive_to(3)
        with pytest.raises(InputError, match="found another server at work in it; stop that one first"):
            lock_folder(setup.folder, wait_s=0.0)
        await session.drive_to(6)
        await session.close(0.0)

    run_drive(drive)
    run_drive(lambda session: session.open(setup))


def test_links_in_the_folder_of_a_drive_are_not_followed(suite: Path, short_drive: Path, tmp_path: Path) -> None:
    """A stranger's drive must not write outside of its folder."""
    folder, other = copytree(short_drive, tmp_path / "drive"), tmp_path / "other"
    (folder / "takes").rename(other)
    (folder / "takes").symlink_to(other)
    (other / ".mine.part").write_text("mine")
    before = sorted(other.rglob("*"))
    with pytest.raises(InputError, match="takes: expected a drive of regular files and folders, found a link"):
        run_drive(lambda session: session.open(make_setup(folder, suite)))
    assert sorted(other.rglob("*")) == before


def test_a_journal_with_a_number_that_no_take_has_is_no_take(suite: Path, short_drive: Path, tmp_path: Path) -> None:
    folder = copytree(short_drive, tmp_path / "drive")
    for number in (0, 2**32):
        copyfile(folder / "takes" / "1.actions.jsonl", folder / "takes" / f"{number}.actions.jsonl")

    async def go_on(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite))
        assert {*session.process.tree.takes} == {1, 2}

    run_drive(go_on)
