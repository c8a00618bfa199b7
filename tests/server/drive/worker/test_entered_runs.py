"""Any tick of a recorded run is entered: the run is repeated bit for bit, then the person has the wheel."""

from pathlib import Path

import pytest
from testing.drives import SCENARIO, DriveSession, make_setup, run_drive, verify
from testing.takes import invoke, load_recorded

from mdrive_sumo.core.errors import InputError
from server.drive.simulation_process import (
    SimulationProcess,
)

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]


@pytest.mark.parametrize(
    ("agent", "goes_on"),
    [
        ("sharing+negotiation", "sharing+negotiation"),
        # Its replies are repeated as those of an agent that is not built in, which the next test enters.
        pytest.param("idm", "sharing", marks=pytest.mark.full),
    ],
)
def test_any_tick_of_a_run_is_entered(suite: Path, tmp_path: Path, agent: str, goes_on: str) -> None:
    """The run's agents drive again up to the tick; then the person has the wheel, and the agents drive on.

    `idm` needs a sensor that the car of a person lacks: its replies are repeated, and another agent drives on.
    """
    run = tmp_path / "run"
    ended = invoke("eval", "--suite", suite, "--scenario", SCENARIO, "--agent", agent, "--out", run)
    assert ended.exit_code == 0, ended.output
    entered = load_recorded(run)

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(tmp_path / "drive", suite, from_run=run, from_tick=31))
        assert session.frames == [] or session.tick == 31
        assert session.process.tree.takes[1].drivers == {"0": "human", "1": goes_on}
        await session.drive_to(60)
        await session.process.branch(1, 12)  # before the tick that was entered: the person takes over there
        assert session.process.tree.takes[2].drivers == {"0": "human", "1": goes_on}
        await session.drive_to(10_000)
        await session.wait_until_ended(1, 2)
        assert session.problems == []
        await session.close()

    run_drive(drive)
    for number, tick in ((1, 31), (2, 12)):
        record = load_recorded(tmp_path / "drive" / "takes" / str(number))
        assert (record.digests[:tick] == entered.digests[:tick]).all()
        assert record.digest != entered.digest
        verify(tmp_path / "drive" / "takes" / str(number))


def test_a_run_of_an_agent_that_is_not_built_in_is_entered_by_its_replies(suite: Path, tmp_path: Path) -> None:
    source = tmp_path / "mine.py"
    source.write_text(
        "from mdrive_sumo.contract import Control, Reply\n"
        "class Mine:\n"
        "    label = 'single'\n"
        "    def __init__(self, config): pass\n"
        "    def sensors(self): return ()\n"
        "    def start(self, briefing): pass\n"
        "    def act(self, seen): return Reply(Control(0.2 + 0.01 * (seen.tick % 7), 0.0, 0.0))\n"
    )
    run = tmp_path / "run"
    ended = invoke("eval", "--suite", suite, "--scenario", SCENARIO, "--agent", f"{source}:Mine", "--out", run)
    assert ended.exit_code == 0, ended.output
    entered = load_recorded(run)

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(tmp_path / "drive", suite, from_run=run, from_tick=25))
        assert session.process.tree.takes[1].drivers == {"0": "human", "1": "sharing"}
        await session.drive_to(10_000)
        await session.wait_until_ended(1)
        await session.close()

    run_drive(drive)
    record = load_recorded(tmp_path / "drive" / "takes" / "1")
    assert (record.digests[:25] == entered.digests[:25]).all()
    verify(tmp_path / "drive" / "takes" / "1")
    bad = SimulationProcess()

    async def enter_too_late(session: DriveSession) -> None:
        session.process = bad
        await session.open(make_setup(tmp_path / "late", suite, from_run=run, from_tick=100_000))

    with pytest.raises(InputError, match="tick: expected one before its end"):
        run_drive(enter_too_late)


@pytest.mark.full
def test_a_take_with_other_agents_than_the_drive_is_entered(suite: Path, tmp_path: Path) -> None:
    """The agents that drove in it drive again, and its cars send what they sent."""
    take = tmp_path / "first" / "takes" / "1"

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(take.parents[1], suite, substitutes=("single",), v2x="off"))
        await session.drive_to(10)
        await session.process.hand_over("0", "single")
        await session.drive_to(20)
        await session.close()

    run_drive(drive)

    async def enter(session: DriveSession) -> None:
        await session.open(make_setup(tmp_path / "second", suite, from_run=take, from_tick=15))
        assert session.process.facts.agents == ("sharing", "single")
        await session.drive_to(25)
        await session.process.branch(1, 18)
        await session.wait_for(lambda: session.frames[-1].take == 2)
        await session.drive_to(22)
        await session.close()
        assert session.problems == []

    run_drive(enter)
    for number in (1, 2):
        record = load_recorded(tmp_path / "second" / "takes" / str(number))
        assert (record.digests[:15] == load_recorded(take).digests[:15]).all()
        verify(tmp_path / "second" / "takes" / str(number))
