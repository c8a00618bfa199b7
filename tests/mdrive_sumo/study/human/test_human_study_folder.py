"""The folder of a study: whole after every step, the same after a kill, and without what was withdrawn."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from testing.human_study import PAIRED, make_plan

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.study.human.drive_order import plan_drives
from mdrive_sumo.study.human.human_study_folder import ORGANISER, HumanStudyFolder
from mdrive_sumo.study.human.participant_progress import ParticipantProgress


def fill(study: HumanStudyFolder, code: str) -> None:
    """Let a participant have driven every drive."""
    progress = ParticipantProgress(code=code).consent(5)
    for drive in plan_drives(study.plan, code):
        entry = study.make_entry(code, "counted", drive)
        take = study.folder / entry.folder / "takes" / "1"
        take.mkdir(parents=True, exist_ok=True)
        (take / "results.json").write_text(f"secret of {code}")
        progress = progress.open_drive(entry, study.plan.breaks, 6).end_drive(f"{entry.folder}/takes/1", True, 7)
        progress = progress.answer_drive({"safe": 3.0})
    study.save_progress(progress)


def list_files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_progress_is_what_was_saved(tmp_path: Path) -> None:
    study = HumanStudyFolder.create(tmp_path / "study", make_plan(), "persons")
    assert study.load_progress("P01") == ParticipantProgress(code="P01")
    fill(study, "P01")
    again = HumanStudyFolder.open_existing(tmp_path / "study")
    assert again.load_progress("P01") == study.load_progress("P01")
    assert [progress.code for progress in again.list_progress()] == ["P01", "P02", "P03", "P04"]


def test_withdrawal_leaves_the_fact_and_the_time_only(tmp_path: Path) -> None:
    study = HumanStudyFolder.create(tmp_path / "study", make_plan(), "persons")
    fill(study, "P01")
    fill(study, "P02")
    (study.folder / "results").mkdir()
    (study.folder / "results" / "drives.csv").write_text("P01")
    others = [name for name in list_files(study.folder) if "P02" in name]
    study.withdraw("P01", 1234)
    study.withdraw("P01", 9999)  # a second click
    left = list_files(study.folder)
    assert [name for name in left if "P02" in name] == others
    assert not [name for name in left if "P01" in name or name.startswith("results")]
    assert json.loads((study.folder / "withdrawals.json").read_text()) == [{"code": "P01", "at": 1234}]
    assert "secret of P01" not in "".join((study.folder / name).read_text() for name in left)
    assert [progress.code for progress in study.list_progress()] == ["P02", "P03", "P04"]
    with pytest.raises(InputError, match="withdrew"):
        study.save_progress(ParticipantProgress(code="P01"))


def test_takes_of_a_pair_go_with_either_of_them(tmp_path: Path) -> None:
    study = HumanStudyFolder.create(tmp_path / "study", make_plan(conditions=PAIRED), "persons")
    fill(study, "P01")
    fill(study, "P02")
    assert any(name.startswith("pairs/P01+P02/") for name in list_files(study.folder))
    study.withdraw("P02", 1)
    left = list_files(study.folder)
    assert not any(name.startswith("pairs/") for name in left)
    assert any(name.startswith("participants/P01/drives/") for name in left)


def test_a_deletion_that_was_cut_off_is_finished_when_the_folder_is_opened(tmp_path: Path) -> None:
    study = HumanStudyFolder.create(tmp_path / "study", make_plan(), "persons")
    fill(study, "P03")
    (study.folder / "withdrawals.json").write_text(json.dumps([{"code": "P03", "at": 7}]))
    HumanStudyFolder.open_existing(study.folder)
    assert not [name for name in list_files(study.folder) if "P03" in name]


def test_another_plan_or_other_drivers_never_continue_in_a_folder(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    HumanStudyFolder.create(folder, make_plan(), "persons")
    HumanStudyFolder.create(folder, make_plan(), "persons")
    with pytest.raises(InputError, match="expected the plan with which the study began, found another title, seed"):
        HumanStudyFolder.create(folder, make_plan(title="Another", seed=3), "persons")
    with pytest.raises(InputError, match="expected a study of scripted, found one of persons"):
        HumanStudyFolder.create(folder, make_plan(), "scripted")


def test_folders_that_hold_something_else_are_refused(tmp_path: Path) -> None:
    (tmp_path / "thing").write_text("x")
    with pytest.raises(InputError, match="expected a new or empty folder"):
        HumanStudyFolder.create(tmp_path, make_plan(), "persons")
    with pytest.raises(InputError, match=r"expected the folder of a study with study\.json, found none"):
        HumanStudyFolder.open_existing(tmp_path)


@pytest.mark.parametrize(
    ("file", "content", "sentence"),
    [
        ("study.json", "{", "JSON"),
        ("study.json", "{}", "drivers"),
        ("participants/P01/progress.json", '{"code": "P02"}', "expected the progress of P01"),
        ("participants/P01/progress.json", '{"code": "P01", "driver": "scripted:idle"}', "one of persons"),
        ("participants/P01/progress.json", "\xff", "progress.json"),
        ("withdrawals.json", "7", "expected a list of codes and times"),
        ("withdrawals.json", '[{"code": "P01"}]', "expected a list of codes and times"),
        ("links.json", "[]", "expected a link for the organiser"),
        ("links.json", "{", "expected links by code"),
    ],
)
def test_damaged_files_are_one_sentence(tmp_path: Path, file: str, content: str, sentence: str) -> None:
    study = HumanStudyFolder.create(tmp_path / "study", make_plan(), "persons")
    study.load_links()
    path = study.folder / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content, "latin-1")
    with pytest.raises(InputError, match=sentence):
        again = HumanStudyFolder.open_existing(study.folder)
        again.list_withdrawals()
        again.load_links()
        again.load_progress("P01")


def test_links_are_secret_different_and_kept(tmp_path: Path) -> None:
    study = HumanStudyFolder.create(tmp_path / "study", make_plan(), "persons")
    links = study.load_links()
    assert {*links} == {ORGANISER, "P01", "P02", "P03", "P04"}
    assert len(set(links.values())) == 5 and min(map(len, links.values())) >= 24
    assert HumanStudyFolder.open_existing(study.folder).load_links() == links
    assert (study.folder / "links.json").stat().st_mode & 0o077 == 0


def test_two_processes_never_write_in_one_folder(tmp_path: Path) -> None:
    study = HumanStudyFolder.create(tmp_path / "study", make_plan(), "persons")
    with study.lock(), pytest.raises(InputError, match="another process runs this study"), study.lock():
        pass
    with study.lock():
        pass


WRITER = """
import sys
from pathlib import Path
from mdrive_sumo.study.human.human_study_folder import HumanStudyFolder
study = HumanStudyFolder.open_existing(Path(sys.argv[1]))
progress = study.load_progress("P01")
print("ready", flush=True)
for count in range(10**9):
    progress = progress.consent(count)
    study.save_progress(progress)
    study.withdraw("P02", count)
"""


@pytest.mark.slow
def test_kill_9_loses_no_step(tmp_path: Path) -> None:
    """A writer that is killed at any moment leaves whole files."""
    study = HumanStudyFolder.create(tmp_path / "study", make_plan(), "persons")
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(study.folder)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    with process:
        process.stdout.readline()
        while not (study.folder / "participants/P01/progress.json").exists():
            pass
        os.kill(process.pid, signal.SIGKILL)
    again = HumanStudyFolder.open_existing(study.folder)
    assert again.load_progress("P01").consented_at is not None
    assert {*again.list_withdrawals()} <= {"P02"}
