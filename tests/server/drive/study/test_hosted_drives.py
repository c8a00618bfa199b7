"""Drives of a study over the real simulation: given up, continued after a crash, deleted while they go on."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from testing.drive_fakes import FakeSimulation
from testing.human_study import SECOND, write_plan

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scoring import load_results
from mdrive_sumo.study.human.human_study_folder import HumanStudyFolder
from mdrive_sumo.study.human.participant_progress import StepKind
from mdrive_sumo.study.human.plan_file import check_plan, load_plan
from server.drive.drive_host import DriveHost
from server.drive.simulation_process import SimulationProcess
from server.drive.study.study_drives import HostedDrives
from server.drive.study.study_service import StudyService
from server.drive.take_tree import Take, TakeStatus, TakeTree

pytestmark = pytest.mark.slow
LIMIT_S = 40.0
Play = Callable[[StudyService, DriveHost], Awaitable[None]]


def play(
    folder: Path, scene: Play, make_simulation: Callable[[], SimulationProcess] = SimulationProcess, **changes: Any
) -> None:
    """Serve the study of a folder for a scene; at its end the server dies, so that nothing is put in order."""
    keys = {"participants": 1, "scenarios": [SECOND], "conditions": [{"name": "view"}], **changes}
    plan = load_plan(write_plan(folder, **keys))
    study = HumanStudyFolder.create(folder / "study", plan, "persons")

    async def run() -> None:
        host = DriveHost(make_simulation=make_simulation)
        try:
            await scene(StudyService(study, HostedDrives(host, study, check_plan(plan, "plan")), lambda: 1000), host)
        finally:
            await host.close(wait_s=0.0)

    asyncio.run(run())


async def wait_for_step(service: StudyService, kind: StepKind) -> None:
    for _ in range(round(LIMIT_S / 0.05)):
        _, step = await service.find_step("P01")
        if step.kind is kind:
            return
        await asyncio.sleep(0.05)
    raise AssertionError(f"expected the step {kind}")


async def wait_until(is_so: Callable[[], bool]) -> None:
    for _ in range(round(LIMIT_S / 0.05)):
        if is_so():
            return
        await asyncio.sleep(0.05)
    raise AssertionError("expected it to become so")


@pytest.mark.full
def test_a_drive_is_continued_after_a_crash_and_counts_when_it_is_given_up(tmp_path: Path) -> None:
    async def begin(service: StudyService, host: DriveHost) -> None:
        await service.consent("P01")
        path = await service.open_drive("P01")
        assert path.startswith("/drive/0?token=")
        session = host.find_session(f"participants/P01/drives/00-{SECOND}")
        assert session is not None
        assert session.rules.v2x_view and not session.rules.chat and not session.rules.may_rewind
        assert await service.open_drive("P01") == path, "the same drive, not another one"
        with pytest.raises(InputError, match="expected one that has begun, found one at its start"):
            await service.give_up("P01")
        await session.simulation.resume()
        await wait_until(lambda: session.frame is not None and session.frame.tick > 5)
        await wait_for_step(service, StepKind.DRIVING)

    async def go_on(service: StudyService, host: DriveHost) -> None:
        await wait_for_step(service, StepKind.DRIVING)
        assert (await service.open_drive("P01")).startswith("/drive/0?token=")
        await service.give_up("P01")
        await wait_for_step(service, StepKind.QUESTIONS)
        assert host.list_drives() == []

    play(tmp_path, begin)
    play(tmp_path, go_on)
    (entry,) = HumanStudyFolder.open_existing(tmp_path / "study").load_progress("P01").drives
    (result,) = load_results(tmp_path / "study" / entry.take / "results.json").scenarios
    assert not entry.is_success and result.egos[0].reason.startswith("left: the person left at tick")


def test_two_in_a_pair_have_a_link_each_to_one_drive(tmp_path: Path) -> None:
    async def begin(service: StudyService, host: DriveHost) -> None:
        for code in ("P01", "P02"):
            await service.consent(code)
        first, second = [await service.open_drive(code) for code in ("P01", "P02")]
        assert first.startswith("/drive/0?token=") and second.startswith("/drive/1?token=")
        (name,) = host.list_drives()
        session = host.find_session(name)
        assert name == f"pairs/P01+P02/00-{SECOND}" and session is not None
        assert session.rules.chat and session.rules.return_paths == {
            "0": service.make_path("P01"),
            "1": service.make_path("P02"),
        }

    play(tmp_path, begin, participants=2, conditions=[{"name": "together", "partner": "person", "chat": True}])


def test_who_withdraws_in_the_middle_of_a_drive_leaves_nothing(tmp_path: Path) -> None:
    async def withdraw(service: StudyService, host: DriveHost) -> None:
        await service.consent("P01")
        await service.open_drive("P01")
        await service.withdraw("P01")
        assert host.list_drives() == []
        await asyncio.sleep(0.2)  # whatever might still write
        assert not (service.study.folder / "participants" / "P01").exists()

    play(tmp_path, withdraw)
    assert {path.name for path in (tmp_path / "study").rglob("*") if path.is_file()} == {
        "study.json",
        "links.json",
        "withdrawals.json",
    }


@pytest.mark.parametrize("spoil", ["void", "ended"])
def test_a_drive_that_cannot_go_on_begins_anew(tmp_path: Path, spoil: str) -> None:
    """Its last take is void, or its simulation has ended for good: the participant is not stuck with a dead link."""

    async def begin(service: StudyService, host: DriveHost) -> None:
        await service.consent("P01")
        first = await service.open_drive("P01")
        (name,) = host.list_drives()
        session = host.find_session(name)
        assert session is not None
        if spoil == "void":
            TakeTree(service.study.folder / name, {}, {1: Take(1, status=TakeStatus.VOID)}).save()
        else:
            session.has_ended = True
        assert await service.open_drive("P01") != first
        assert host.list_drives() == [name] and host.find_session(name) is not session

    play(tmp_path, begin, make_simulation=FakeSimulation)
