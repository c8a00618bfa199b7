"""`mdrive-sumo generate --hard`: interrupted, hidden, with bad input and in worker processes."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from testing.hard_command import read_contents, run_command, use_toy_family
from testing.toy_family import evaluate_by_formula, make_check

from mdrive_sumo.cli import generate_hard
from mdrive_sumo.generate.generated_suite import load_recipes
from mdrive_sumo.generate.hard import adversarial_search, candidate_evaluation, hard_selection
from mdrive_sumo.generate.hard.behaviour_archive import BATCH
from mdrive_sumo.generate.hard.elite_check import EliteCheck, EliteTask

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]

SECRET = "battery horse staple correct"


@pytest.fixture(scope="module", autouse=True)
def toy() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        use_toy_family(patch)
        yield


@pytest.fixture
def formula(monkeypatch: pytest.MonkeyPatch) -> None:
    """Candidates and elites are not driven, and no pictures drawn."""

    def check(task: EliteTask) -> EliteCheck:
        return make_check(task.scenario.id, *[100.0] * task.seeds)

    monkeypatch.setattr(adversarial_search, "evaluate_candidate", evaluate_by_formula)
    monkeypatch.setattr(hard_selection, "check_elite", check)
    monkeypatch.setattr(generate_hard, "draw_archives", lambda *_: ())


def test_an_interrupted_command_continues_to_the_same_suite(
    formula: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = ("generate", "--hard", "--budget", 3 * BATCH, "--count", 2, "--out")
    assert run_command(*order, tmp_path / "one" / "suite").exit_code == 0
    monkeypatch.setattr("signal.signal", lambda *_: None)
    calls: list[str] = []

    def interrupt(task: candidate_evaluation.CandidateTask) -> candidate_evaluation.CandidateEvaluation:
        calls.append(task.candidate.scenario_id)
        if len(calls) == 11:
            raise KeyboardInterrupt
        return evaluate_by_formula(task)

    monkeypatch.setattr(adversarial_search, "evaluate_candidate", interrupt)
    two = tmp_path / "two" / "suite"
    stopped = run_command(*order, two)
    assert stopped.exit_code == 130 and "interrupted; the same command continues" in stopped.output
    with (two.parent / "suite.search" / "journal.jsonl").open("a") as journal:
        journal.write('{"result": {"id"')  # torn by a power cut
    again = run_command(*order, two)
    assert again.exit_code == 0 and "continuing: the journal holds 8 candidates" in again.output
    assert "the last line of the journal was incomplete" in again.output
    assert len(calls) == 11 + 3 * BATCH - 8 and read_contents(two) == read_contents(tmp_path / "one" / "suite")
    archives = [(tmp_path / name / "suite.search" / "archive.json").read_bytes() for name in ("one", "two")]
    assert archives[0] == archives[1]


def test_a_search_starts_from_an_earlier_suite(formula: None, tmp_path: Path) -> None:
    order = ("generate", "--hard", "--budget", BATCH, "--count", 3, "--out")
    assert run_command(*order, tmp_path / "old").exit_code == 0
    again = run_command(*order, tmp_path / "new", "--start-from", tmp_path / "old")
    assert again.exit_code == 0 and f"1/{BATCH + 3}  " in again.output
    old = {home.name for home in load_recipes(str(tmp_path / "old"))}
    lines = (tmp_path / "new.search" / "journal.jsonl").read_text().splitlines()[1:]
    found = [json.loads(line)["result"] for line in lines]
    driven = [one["id"] for one in found if "evaluation" in one]
    assert set(driven[:3]) == old and len(set(driven)) == BATCH + 3
    other = run_command(*order, tmp_path / "other", "--search-folder", tmp_path / "new.search")
    assert other.exit_code == 2 and "found one with another start" in other.output


def test_hidden_scenarios_are_others_and_files_do_not_hold_the_secret(formula: None, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text(SECRET)
    order = ("generate", "--hard", "--budget", BATCH, "--count", 2, "--out")
    hidden = ("--split", "hidden", "--seed-file", tmp_path / "secret")
    for out, more in (("public", ()), ("hidden", hidden)):
        assert run_command(*order, tmp_path / out, *more).exit_code == 0
    public, secret = (load_recipes(str(tmp_path / name)).values() for name in ("public", "hidden"))
    assert all(recipe.id.startswith("toy_h") for recipe in secret)
    assert not {recipe.seed for recipe in public} & {recipe.seed for recipe in secret}
    assert not any(SECRET.encode() in data for data in read_contents(tmp_path / "hidden").values())
    assert SECRET not in (tmp_path / "hidden.search" / "journal.jsonl").read_text()


def test_fewer_scenarios_than_asked_for(formula: None, tmp_path: Path) -> None:
    found = run_command("generate", "--hard", "--budget", 1, "--count", 100, "--out", tmp_path / "suite")
    assert found.exit_code == 1 and " of 100 scenarios" in found.output
    again = run_command("generate", "--hard", "--count", 1, "--no-search", "--out", tmp_path / "suite.search" / "less")
    assert again.exit_code == 2 and "expected a scenario among 0 candidates, found none" in again.output


BAD_INPUT: list[tuple[tuple[object, ...], str]] = [
    (("--family", "tox"), "family: expected one of toy, found 'tox'; did you mean 'toy'?"),
    (("--category", "crosswalk"), "--hard chooses families, so --category does not go with it"),
    (("--proposer", "template"), "--proposer goes not with --hard"),
    (("--split", "hidden"), "expected --seed-file together with --split hidden"),
    (("--budget", 0), "0 is not in the range"),
    (("--start-from", "interdrive"), "recipe.json: "),
    (("--start-from", "hardd"), "hardd"),
    (("--start-from", "hard"), "family: expected one of toy, found 'blind-crossing'"),
]


@pytest.mark.parametrize(("more", "problem"), BAD_INPUT)
def test_bad_input(more: tuple[object, ...], problem: str, tmp_path: Path) -> None:
    found = run_command("generate", "--hard", "--out", tmp_path / "suite", *more)
    assert found.exit_code == 2 and problem in found.output, found.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("missing", ["ribs", "scipy"])
def test_without_a_package_there_is_one_sentence(missing: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == missing else name)
    found = run_command("generate", "--hard", "--out", tmp_path / "suite")
    assert found.exit_code == 2 and f"expected the package {missing}" in found.output
    assert "pip install '.[search]'" in found.output


@pytest.mark.full  # the cheap siblings shuffle and interrupt in one process
def test_worker_processes_and_ctrl_c(tmp_path: Path) -> None:
    program = (
        "import sys\n"
        "from testing.toy_family import TOY, TOY_FAMILY\n"
        "from mdrive_sumo.generate.hard import families\n"
        "families.FAMILIES = {TOY: TOY_FAMILY}\n"
        "from mdrive_sumo.cli import main\n"
        "main(sys.argv[1:])\n"
    )
    archives: list[bytes] = []
    for workers, stop in ((1, False), (3, True)):
        out = tmp_path / str(workers) / "suite"
        order = (
            "generate",
            "--hard",
            "--budget",
            "16",
            "--count",
            "1",
            "--workers",
            str(workers),
            "--out",
            str(out),
        )
        for interrupted in (stop, False):
            process = subprocess.Popen(
                [sys.executable, "-c", program, *order], cwd="tests", stderr=subprocess.PIPE, text=True
            )
            assert process.stderr is not None
            if interrupted:
                process.stderr.readline()
                process.send_signal(signal.SIGINT)
            process.communicate(timeout=600)
            assert process.returncode == (130 if interrupted else 2)  # the rules lose nothing here: no elites
        archives.append((tmp_path / str(workers) / "suite.search" / "archive.json").read_bytes())
    assert archives[0] == archives[1]
