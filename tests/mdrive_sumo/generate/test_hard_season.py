"""`generate --hard --season N` through the command line, with a family whose figures follow from a formula."""

import json
import shutil
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.local_executor import J, LocalExecutor, R, run_in_process
from testing.toy_family import TOY, TOY_FAMILY, certify_nothing, evaluate_by_formula

from mdrive_sumo.cli import generate_hard, main
from mdrive_sumo.generate.hard import adversarial_search, families, hard_suite
from mdrive_sumo.generate.hard.hard_recipe import load_hard_recipe
from mdrive_sumo.runs.process_pool import WorkerFailure
from mdrive_sumo.scenario.reference_times import find_reference_times
from mdrive_sumo.scenario.suite import load_suite

SECRET = "sixteen characters"
BUDGET = ("--budget", 16, "--workers", 1, "--count", 4)


def run_command(*arguments: object) -> Result:
    """Run `mdrive-sumo generate --hard` with these arguments."""
    return CliRunner().invoke(main, ["generate", "--hard", *map(str, arguments)])


def read_contents(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder by relative path."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module", autouse=True)
def toy() -> Iterator[None]:
    """Search the toy in this process."""
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        patch.setattr(families, "FAMILIES", {TOY: TOY_FAMILY})
        patch.setattr(adversarial_search, "evaluate_candidate", evaluate_by_formula)
        patch.setattr(hard_suite, "certify_candidate", certify_nothing)
        yield


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Season 7 of the toy."""
    out = tmp_path_factory.mktemp("season") / "hard"
    result = run_command("--season", 7, *BUDGET, "--out", out)
    assert result.exit_code == 0, result.output
    assert "4 of 4 scenarios" in result.output and "aims missed" in result.output
    return out


def test_a_season_is_a_sealed_suite_with_its_places(drawn: Path) -> None:
    suite = load_suite(str(drawn))
    assert (suite.label, suite.score_mode, len(suite)) == ("hard@7", "hard", 4)
    assert suite.about.checksum == suite.checksum()
    for scenario in suite.scenarios:
        assert (drawn / "networks" / scenario.network / "network.json").is_file()
        recipe = load_hard_recipe(drawn / scenario.id / "recipe.json")
        limits = {ego.id: ego.time_limit_s for ego in scenario.egos}
        ticks = find_reference_times(scenario, drawn)
        assert limits == recipe.time_limits_s == {name: 1.5 * count / 20 + 2.0 for name, count in ticks.items()}


@pytest.mark.slow
def test_its_recipes_make_it_again_without_any_drive(drawn: Path) -> None:
    result = CliRunner().invoke(main, ["generate", "--rebuild", str(drawn)])
    assert (result.exit_code, result.output) == (0, "4 of 4 scenarios are as their recipes make them\n")


def test_the_journal_chooses_the_same_again_and_is_small(drawn: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def evaluate_nothing(task: object) -> None:
        raise AssertionError(f"expected no evaluation, found {task}")

    monkeypatch.setattr(adversarial_search, "evaluate_candidate", evaluate_nothing)
    search = drawn.parent / "hard.search"
    again = drawn.parent / "again"
    assert run_command("--season", 7, *BUDGET, "--no-search", "--search-folder", search, "--out", again).exit_code == 0
    assert read_contents(again) == read_contents(drawn)
    lines = (search / "journal.jsonl").read_text().splitlines()
    assert len(lines) == 17 and max(map(len, lines)) < 1500


@pytest.mark.slow
def test_an_interrupted_search_continues(drawn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = 0

    def interrupt(task: adversarial_search.CandidateTask) -> adversarial_search.CandidateEvaluation:
        nonlocal calls
        calls += 1
        if calls == 12:
            raise KeyboardInterrupt
        return evaluate_by_formula(task)

    handler = signal.getsignal(signal.SIGINT)
    with monkeypatch.context() as patch:
        patch.setattr(adversarial_search, "evaluate_candidate", interrupt)
        stopped = run_command("--season", 7, *BUDGET, "--out", tmp_path / "hard")
    signal.signal(signal.SIGINT, handler)
    assert stopped.exit_code == 130 and "the same command continues" in stopped.output
    assert not (tmp_path / "hard").exists()
    continued = run_command("--season", 7, *BUDGET, "--out", tmp_path / "hard")
    assert "continuing: the journal holds 11 candidates" in continued.output
    assert read_contents(tmp_path / "hard") == read_contents(drawn)


@pytest.mark.slow
def test_a_continued_search_counts_the_candidates_of_its_families_alone(
    drawn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(drawn.parent / "hard.search", tmp_path / "search")
    other = replace(TOY_FAMILY, category="toy-two")
    monkeypatch.setattr(families, "FAMILIES", {TOY: TOY_FAMILY, other.category: other})
    options = ("--family", other.category, "--search-folder", tmp_path / "search", "--out", tmp_path / "hard")
    output = run_command("--season", 7, *BUDGET, *options).output
    assert "continuing" not in output and "\n1/16  " in output and "\n16/16  " in output and "eta 0:00" in output


class ManyWorkers(LocalExecutor[J, R]):
    """Seven workers; of the jobs that they have the last one is finished first."""

    @property
    def free_slots(self) -> int:
        return 7 - len(self._done)

    def collect_outcomes(self, *_: object) -> list[tuple[str, R | WorkerFailure]]:
        return [self._done.pop()]


@pytest.mark.slow
def test_the_order_in_which_candidates_finish_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generate_hard, "choose_scenarios", lambda *_: ())  # the choice sorts them
    journals: list[list[str]] = []
    for executor in (LocalExecutor, ManyWorkers):
        monkeypatch.setattr(adversarial_search, "ProcessPool", executor)
        out = tmp_path / executor.__name__
        assert "found none; a larger --budget" in run_command("--season", 7, "--budget", 44, "--out", out).output
        lines = (tmp_path / f"{out.name}.search" / "journal.jsonl").read_text().splitlines()
        journals.append([json.dumps(json.loads(line)["result"]) for line in lines[1:]])
    one, many = journals
    assert one != many and sorted(one) == sorted(many)


@pytest.mark.slow
def test_a_secret_makes_another_season_that_does_not_tell_it(drawn: Path, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text(SECRET)
    out = tmp_path / "hidden"
    assert run_command("--season", 7, "--secret", tmp_path / "secret", *BUDGET, "--out", out).exit_code == 0
    public, hidden = load_suite(str(drawn)), load_suite(str(out))
    assert hidden.label == "hard@secret-7"
    assert not {one.network for one in public} & {one.network for one in hidden}
    files = read_contents(tmp_path)
    del files["secret"]
    assert not [name for name, content in files.items() if SECRET.encode() in content]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((), "--hard: expected --season N, found none"),
        (("--season", 0), "--season 0: expected a number from 1 to 9999"),
        (("--season", "word"), "--season word: expected a number, found a word, which needs --secret"),
        (("--season", 1, "--seed", 3), "--seed goes not with --hard"),
        (("--season", 1, "--split", "hidden"), "--split goes not with --hard"),
        (("--season", 1, "--bucket", "v2xpnp"), "--bucket goes not with --hard"),
        (("--season", 1, "--category", "overtaking"), "--category goes not with --hard"),
        (("--season", 1, "--family", "tey"), "family: expected"),
        (("--season", 1, "--secret", "none"), "expected a private seed of 16 characters or more, found no file"),
    ],
)
def test_bad_options_get_one_sentence(arguments: tuple[object, ...], sentence: str, tmp_path: Path) -> None:
    result = run_command(*arguments, "--out", tmp_path / "hard")
    assert result.exit_code == 2 and sentence in result.output and "Traceback" not in result.output
    assert not (tmp_path / "hard").exists()


def test_options_of_the_search_go_only_with_it(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["generate", "--season", "1", "--budget", "8", "--out", str(tmp_path / "x")])
    assert result.exit_code == 2 and "--budget goes" in result.output


def test_a_journal_of_another_family_is_refused(drawn: Path, tmp_path: Path) -> None:
    source = (drawn.parent / "hard.search" / "journal.jsonl").read_text().splitlines()
    assert json.loads(source[1])["result"]["family"] == TOY
    other = tmp_path / "search"
    other.mkdir()
    (other / "journal.jsonl").write_text((drawn.parent / "hard.search" / "journal.jsonl").read_text())
    result = run_command("--season", 8, *BUDGET, "--search-folder", other, "--out", tmp_path / "hard")
    assert result.exit_code == 2 and "--fresh" in result.output
