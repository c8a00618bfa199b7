"""Studies with persons: a small plan, its folder, and drives that nobody has to drive. No tests in here."""

import json
from pathlib import Path
from typing import Any

from mdrive_sumo.study.human.drive_order import PlannedDrive
from mdrive_sumo.study.human.human_study_folder import HumanStudyFolder
from mdrive_sumo.study.human.human_study_plan import HumanStudyPlan
from mdrive_sumo.study.human.participant_progress import DriveEntry
from testing.short_suite import make_short_suite

FIRST, SECOND = "i01_ins_c_main_street_right", "i07_ins_ss_town"
"""Two CAVs each."""
PLAN: dict[str, Any] = {
    "title": "A small study",
    "consent": "Taking part is voluntary.",
    "contact": "the desk",
    "participants": 4,
    "suite": "interdrive",
    "scenarios": [FIRST, SECOND],
    "conditions": [{"name": "view"}, {"name": "blind", "v2x_view": False}],
    "questionnaires": {
        "after_drive": [{"id": "safe", "kind": "likert", "text": "I drove safely."}],
        "at_end": [{"id": "comment", "kind": "text", "text": "Anything else?", "optional": True}],
    },
    "breaks": {"between_drives_s": 0},
    "compare": ["stationary"],
}
PAIRED = [{"name": "alone"}, {"name": "together", "partner": "person", "chat": True}]


def make_plan(**changes: Any) -> HumanStudyPlan:
    return HumanStudyPlan.model_validate(PLAN | changes)


def write_plan(folder: Path, **changes: Any) -> Path:
    """Write a plan over a suite of scenarios that end after a few seconds."""
    suite = folder / "suite"
    if not suite.exists():
        make_short_suite(suite, "i01_*", "i07_*")
    path = folder / "plan.json"
    path.write_text(json.dumps(PLAN | {"suite": str(suite)} | changes))
    return path


class MadeDrives:
    """`StudyDrives` without a simulation: a drive ends when a test says so."""

    def __init__(self, study: HumanStudyFolder) -> None:
        self._study = study
        self.opened: list[DriveEntry] = []
        self.closed: list[str] = []
        self.left: list[str] = []
        self.return_paths: dict[int, str] = {}
        self.takes: dict[str, str] = {}
        """Take by the folder of a drive."""

    async def open(self, entry: DriveEntry, drive: PlannedDrive, return_paths: dict[int, str]) -> str:
        self.opened.append(entry)
        self.return_paths = return_paths
        (self._study.folder / entry.folder).mkdir(parents=True, exist_ok=True)
        return f"/drive/{drive.cav}?token=x"

    def find_take(self, entry: DriveEntry) -> str:
        return self.takes.get(entry.folder, "")

    async def settle(self, entry: DriveEntry) -> None:
        pass

    async def leave(self, entry: DriveEntry) -> None:
        self.left.append(entry.folder)

    async def close(self, entry: DriveEntry) -> None:
        self.closed.append(entry.folder)

    def end(self, entry: DriveEntry) -> None:
        """Let a drive be stored."""
        self.takes[entry.folder] = f"{entry.folder}/takes/1"
