"""A study that scripted drivers drive, from the command to the table; takes that verify; programs count as nobody."""

import csv
import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.human_study import FIRST, PAIRED, SECOND, write_plan

from mdrive_sumo.cli import main
from mdrive_sumo.contract import REMARK
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import load_episode
from mdrive_sumo.study.human.human_report import NO_PERSON, build_gap_to_humans, build_human_table, list_groups
from mdrive_sumo.study.human.human_results import HumanStudyResults, format_drives_csv
from mdrive_sumo.study.human.human_study_folder import HumanStudyFolder
from mdrive_sumo.study.human.plan_file import check_plan, load_plan
from mdrive_sumo.study.human.scripted_study import assign_kinds, run_scripted_study
from mdrive_sumo.study.human.write_human_results import load_human_results

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture, pytest.mark.usefixtures("in_process")]
KINDS = ["attentive", "distracted"]


def invoke(*words: str | Path) -> Result:
    return CliRunner().invoke(main, ["study", "human", *map(str, words)])


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Result]]:
    folder = tmp_path_factory.mktemp("scripted")
    plan = write_plan(folder, participants=2, practice={"scenarios": [FIRST], "drives": 1}, conditions=[{"name": "a"}])
    done = invoke(
        "--plan", plan, "--out", folder / "study", "--scripted", ",".join(KINDS), "--results", "--workers", "1"
    )
    yield folder / "study", done


@pytest.fixture(scope="module")
def results(driven: tuple[Path, Result]) -> HumanStudyResults:
    return load_human_results(HumanStudyFolder.open_existing(driven[0]), {})


def test_the_command_drives_everything_and_writes_the_table(driven: tuple[Path, Result]) -> None:
    folder, done = driven
    assert done.exit_code == 0, done.output
    assert "scripted:attentive" in done.output and NO_PERSON in done.output
    page = (folder / "results" / "human_study.md").read_text()
    assert f"persons | {NO_PERSON}" in page and "programs, not persons" in page and "stationary" in page
    for name in ("human_study.html", "csv/rq4.csv", "latex/rq4.tex", "figures/rq4_figure.svg", "drives.csv"):
        assert (folder / "results" / name).is_file()


def test_takes_are_runs_that_verify(driven: tuple[Path, Result]) -> None:
    folder, _ = driven
    takes = sorted(folder.glob("participants/*/*/*/takes/1"))
    assert len(takes) == 2 * (1 + 2)
    checked = CliRunner().invoke(main, ["verify", str(takes[-1]), "--workers", "1"])
    assert checked.exit_code == 0 and "1 of 1 scenarios are identical" in checked.output, checked.output


def test_the_recording_itself_says_that_a_program_drove(driven: tuple[Path, Result]) -> None:
    (path,) = driven[0].glob(f"participants/P02/drives/*{SECOND}/takes/1/episodes/*.npz")
    record = load_episode(path)
    remarks = [one.note.text for one in record.notes if one.note.kind == REMARK]
    assert remarks == ["scripted:distracted: a program, not a person"]


def test_one_line_of_csv_for_each_drive(results: HumanStudyResults) -> None:
    rows = list(csv.DictReader(io.StringIO(format_drives_csv(results))))
    assert len(rows) == 4
    assert {row["driver"] for row in rows} == {"scripted:attentive", "scripted:distracted"}
    assert {row["scenario"] for row in rows} == {FIRST, SECOND}
    assert [row["order"] for row in rows if row["code"] == "P01"] == ["1", "2"]
    for row in rows:
        assert 0 <= float(row["ds"]) <= 100 and row["sr"] in ("0", "100")
        assert float(row["ds"]) == pytest.approx(float(row["rc"]) * float(row["ip"]), abs=1e-4)
        assert (row["interventions"], row["device"], row["answer_safe"]) == ("0", "script", "")


def test_programs_are_never_counted_as_persons(results: HumanStudyResults) -> None:
    assert results.persons == () and len(results.scripted) == 4
    table = build_human_table(results)
    first = table.rows[0]
    assert (first.cells[0].value, first.cells[1].value) == ("persons", NO_PERSON)
    assert {cell.value for cell in first.cells[2:]} == {None}
    assert [group.name for group in list_groups(results)] == ["scripted:attentive", "scripted:distracted"]
    assert build_gap_to_humans(results) is None  # without agents


def test_the_same_command_drives_nothing_twice(driven: tuple[Path, Result]) -> None:
    folder, _ = driven
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*.npz")}
    again = invoke(folder, "--scripted", ",".join(KINDS))
    assert again.exit_code == 0 and again.output == ""
    assert before == {path: path.stat().st_mtime_ns for path in folder.rglob("*.npz")}


def test_scripted_drivers_drive_the_same_again(driven: tuple[Path, Result], tmp_path: Path) -> None:
    folder, _ = driven
    again = HumanStudyFolder.create(tmp_path / "again", HumanStudyFolder.open_existing(folder).plan, "scripted")
    suite = check_plan(again.plan, "plan")
    with pytest.raises(KeyboardInterrupt):
        run_scripted_study(again, suite, KINDS, _stop_after(3))
    digests = [json.loads(path.read_text())["scenarios"][0]["digest"] for path in _list_results(again.folder)]
    assert digests == [
        json.loads((folder / path.relative_to(again.folder)).read_text())["scenarios"][0]["digest"]
        for path in _list_results(again.folder)
    ]
    assert len(digests) == 3 and len(set(digests)) > 1


def _stop_after(count: int) -> Callable[[str], None]:
    told: list[str] = []

    def report(line: str) -> None:
        told.append(line)
        if len(told) == count:
            raise KeyboardInterrupt

    return report


def _list_results(folder: Path) -> list[Path]:
    return sorted(folder.glob("participants/*/*/*/takes/1/results.json"))


def test_two_in_a_pair_share_one_take(tmp_path: Path) -> None:
    plan = load_plan(write_plan(tmp_path, participants=2, scenarios=[SECOND], conditions=PAIRED[1:]))
    study = HumanStudyFolder.create(tmp_path / "study", plan, "scripted")
    run_scripted_study(study, check_plan(plan, "plan"), KINDS, lambda _: None)
    first, second = load_human_results(study, {}).drives
    assert {first.driver, second.driver} == {"scripted:attentive", "scripted:distracted"}
    assert first.cav != second.cav and first.scenario_ds == second.scenario_ds
    assert len(list(study.folder.glob("pairs/P01+P02/*/takes/1/results.json"))) == 1


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "expected either --plan FILE with --out DIR, or the DIR of a study"),
        (("--plan", "p"), "expected either --plan FILE"),
        (("--plan", "PLAN", "--out", "NEW", "--scripted", "bored"), "expected one of attentive, distracted, impatient"),
        (("--plan", "PLAN", "--out", "NEW", "--scripted", ""), "expected 1 to 4 different kinds"),
        (("--plan", "PLAN", "--out", "NEW", "--scripted", "attentive,attentive"), "different kinds"),
        (("--plan", "absent.yaml", "--out", "NEW"), "absent.yaml: cannot be read"),
        (("STUDY", "--scripted", "impatient,attentive"), "expected scripted:attentive for P01"),
        (("STUDY",), "expected a study of persons, found one of scripted drivers"),
        (("NEW",), "expected the folder of a study with study.json"),
    ],
)
def test_bad_input_is_one_sentence(
    driven: tuple[Path, Result], tmp_path: Path, words: tuple[str, ...], sentence: str
) -> None:
    places = {"PLAN": write_plan(tmp_path), "NEW": tmp_path / "new", "STUDY": driven[0]}
    result = invoke(*(str(places.get(word, word)) for word in words))
    assert result.exit_code == 2
    assert sentence in " ".join(result.output.split())


def test_more_kinds_than_participants_are_refused(tmp_path: Path) -> None:
    plan = load_plan(write_plan(tmp_path, participants=1))
    with pytest.raises(InputError, match="expected one kind, no more"):
        assign_kinds(plan, KINDS)


def test_the_printed_example_is_a_plan(tmp_path: Path) -> None:
    printed = invoke("--example")
    assert printed.exit_code == 0
    (tmp_path / "plan.yaml").write_text(printed.output)
    assert len(load_plan(tmp_path / "plan.yaml").scenarios) == 12
