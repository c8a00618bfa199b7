"""The drives of a study on the server of drives: opened for a participant, and found when they are finished."""

from contextlib import suppress
from typing import Protocol

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.study.human.drive_order import PlannedDrive
from mdrive_sumo.study.human.human_study_folder import HumanStudyFolder
from mdrive_sumo.study.human.human_study_plan import PERSON, StudyCondition
from mdrive_sumo.study.human.participant_progress import DriveEntry
from mdrive_sumo.study.human.scripted_study import DEFAULT_PARTNER
from server.drive.access import SeatRole
from server.drive.drive_host import DriveHost
from server.drive.session_rules import SessionRules
from server.drive.simulation_process import SimulationEnded
from server.drive.simulation_values import DriveSetup
from server.drive.take_tree import TAKES_FOLDER, Take, TakeStatus, has_tree, load_tree


class StudyDrives(Protocol):
    """Opens drives, and finds the take that counts."""

    async def open(self, entry: DriveEntry, drive: PlannedDrive, return_paths: dict[int, str]) -> str:
        """Return the path of the drive page for the participant's CAV; the drive begins, or goes on where it stood.

        return_paths: where the page leads at its end, by number of the CAV. Raises InputError.
        """
        ...

    def find_take(self, entry: DriveEntry) -> str:
        """Return the run folder of the take that counts, relative to the study's; "" while there is none."""
        ...

    async def settle(self, entry: DriveEntry) -> None:
        """Let a drive in which all people's CAVs have ended be finished without waiting for the others."""
        ...

    async def leave(self, entry: DriveEntry) -> None:
        """End a drive early: its take is finished without the participant, and counts."""
        ...

    async def close(self, entry: DriveEntry) -> None:
        """End the drive's process and its links, so that its folder can be deleted."""
        ...


class HostedDrives:
    """`StudyDrives` on a `DriveHost`."""

    def __init__(self, host: DriveHost, study: HumanStudyFolder, suite: Suite) -> None:
        self._host, self._study = host, study
        self._ego_ids = {scenario.id: tuple(ego.id for ego in scenario.egos) for scenario in suite}

    async def open(self, entry: DriveEntry, drive: PlannedDrive, return_paths: dict[int, str]) -> str:
        """See StudyDrives."""
        egos = self._ego_ids[entry.scenario]
        if self._is_spoiled(entry):
            await self.close(entry)
        if self._host.find_session(entry.folder) is None:
            numbers = sorted({drive.cav, *((drive.partner_cav,) if drive.condition.has_person else ())})
            setup = self._make_setup(entry, drive.condition, tuple(egos[number] for number in numbers))
            rules = SessionRules(
                chat=drive.condition.chat,
                v2x_view=drive.condition.v2x_view,
                may_rewind=self._study.plan.rewind and entry.kind == "counted",
                may_hand_over=False,
                return_paths={egos[number]: path for number, path in return_paths.items()},
            )
            try:
                await self._host.open_drive(entry.folder, setup, rules)
            except SimulationEnded as error:
                raise InputError(f"drive: the simulation did not start ({error}); try again") from None
        links = self._host.list_links(entry.folder)
        return next(link.path for link in links if link.role is SeatRole.DRIVER and link.cav == egos[entry.cav])

    def _is_spoiled(self, entry: DriveEntry) -> bool:
        """Return whether a drive cannot go on: its simulation is gone for good, or the last take is void."""
        session = self._host.find_session(entry.folder)
        if session is None:
            return False
        takes = self._list_takes(entry)
        return session.has_ended or (bool(takes) and takes[-1].status is TakeStatus.VOID)

    def _list_takes(self, entry: DriveEntry) -> list[Take]:
        """Return the takes of a drive by number; none before it was opened."""
        folder = self._study.folder / entry.folder
        return [take for _, take in sorted(load_tree(folder).takes.items())] if has_tree(folder) else []

    def _make_setup(self, entry: DriveEntry, condition: StudyCondition, people: tuple[str, ...]) -> DriveSetup:
        partner = DEFAULT_PARTNER if condition.partner == PERSON else condition.partner
        plan = self._study.plan
        return DriveSetup(
            scenario=entry.scenario,
            folder=self._study.folder / entry.folder,
            people=people,
            suite=plan.suite_name,
            seed=plan.seed,
            others=partner,
            substitutes=(partner,),
        )

    def find_take(self, entry: DriveEntry) -> str:
        """See StudyDrives."""
        take = choose_take(self._list_takes(entry))
        return f"{entry.folder}/{TAKES_FOLDER}/{take.number}" if take is not None else ""

    async def settle(self, entry: DriveEntry) -> None:
        """See StudyDrives."""
        session = self._host.find_session(entry.folder)
        if session is None or session.has_ended:
            return
        ended = session.simulation.known_extra.get("endings", {})
        if all(cav in ended for cav in session.simulation.facts.people):
            with suppress(InputError, SimulationEnded):  # it is finished, or its process has just ended
                await session.simulation.leave()

    async def leave(self, entry: DriveEntry) -> None:
        """See StudyDrives."""
        session = self._host.find_session(entry.folder)
        if session is None:
            raise InputError("drive: expected one that goes on, found none; continue it first")
        is_moving = session.frame is not None and session.frame.tick > 0
        is_continued = any(take.status is not TakeStatus.RUNNING for take in self._list_takes(entry))
        if not is_moving and not is_continued:  # a take that is left at its start is dropped: nothing would be left
            raise InputError("drive: expected one that has begun, found one at its start; drive, or close the page")
        try:
            await session.simulation.leave()
        except SimulationEnded as error:
            raise InputError(f"drive: {error}") from None

    async def close(self, entry: DriveEntry) -> None:
        """See StudyDrives."""
        if self._host.find_session(entry.folder) is not None:
            await self._host.close_drive(entry.folder, wait_s=0.0)


def choose_take(takes: list[Take]) -> Take | None:
    """Return the take that counts; None while the drive goes on. takes: by number.

    It is the newest one: all before it were left by going back, which only the plan's `rewind` allows, or when the
    server died; then the newest one has the same begin.
    """
    if not takes or takes[-1].status is not TakeStatus.FINISHED:
        return None
    return takes[-1]
