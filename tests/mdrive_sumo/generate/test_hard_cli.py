"""`mdrive-sumo generate --hard` as a user calls it, on a toy family: a suite that is rebuilt, checked and listed."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from testing.hard_command import read_contents, run_command, use_toy_family
from testing.toy_family import TOY

from mdrive_sumo.generate.hard import candidate_evaluation
from mdrive_sumo.generate.hard.behaviour_archive import BATCH
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR
from mdrive_sumo.generate.hard.time_limits import compute_time_limits, set_time_limits
from mdrive_sumo.generate.validation.hard_suite_validation import find_hard_problems
from mdrive_sumo.scenario.reference_times import find_reference_times
from mdrive_sumo.scenario.suite import load_suite, save_suite, seal_suite
from mdrive_sumo.study.need_certificate import NEED_FILE, NeedConflict, read_need, save_need

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]


@pytest.fixture(scope="module", autouse=True)
def toy() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        use_toy_family(patch)
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A suite of two scenarios, and what was printed."""
    out = tmp_path_factory.mktemp("hard") / "suite"
    found = run_command("generate", "--hard", "--budget", BATCH, "--count", 2, "--out", out)
    assert found.exit_code == 0, found.output
    return out, found.output


def test_a_suite_is_written_with_limits_recipes_and_times(made: tuple[Path, str]) -> None:
    folder, said = made
    suite = load_suite(str(folder))
    assert len(suite) == 2 and suite.about.checksum == suite.checksum() and suite.about.score_mode == "hard"
    for scenario in suite:
        ticks = find_reference_times(scenario, folder)
        assert {ego.id: ego.time_limit_s for ego in scenario.egos} == compute_time_limits(ticks) != {}
        assert (scenario.bucket, scenario.category) == ("Hard", TOY)
    assert f"2 of 2 scenarios: {folder}; 1 categories" in said
    assert "omniscient 100 with 2 of 2 seeds" in said


def test_the_archive_is_written_and_drawn(made: tuple[Path, str]) -> None:
    folder = made[0].with_name("suite.search")
    names = {path.name for path in folder.iterdir()}
    pictures = {f"archive{of}.{kind}" for of in ("", "-toy") for kind in ("png", "svg")}
    assert names == pictures | {"archive.json", "journal.jsonl"}
    (family,) = json.loads((folder / "archive.json").read_text())["families"]
    assert family["evaluated"] == BATCH and 1 <= sum(elite["is_chosen"] for elite in family["elites"]) <= 2
    assert "toy: " in (folder / "archive-toy.svg").read_text()


def test_a_suite_is_rebuilt_byte_for_byte_without_any_drive(
    made: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(candidate_evaluation, "drive_with")
    found = run_command("generate", "--rebuild", made[0])
    assert (found.exit_code, found.output) == (0, "2 of 2 scenarios are as their recipes make them\n")
    assert run_command("generate", "--rebuild", made[0], "--out", tmp_path / "new").exit_code == 0
    assert read_contents(tmp_path / "new") == read_contents(made[0])


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('"family":"toy"', '"family":"tox"', "family: expected one of toy, found 'tox'; did you mean 'toy'?"),
        (
            f'"generator":{HARD_GENERATOR}',
            '"generator":7',
            f"expected version {HARD_GENERATOR} of the families, found 7",
        ),
        ('"time_limits_s":{', '"time_limits_s":{"x":3,', "time_limits_s: expected one for each of the CAVs"),
        ('"values":[', '"values":[99,', "toy: expected 2 values, found 3"),
        ('"values":[', '"values":["a",', "values.0: "),
        ("hard-recipe/1", "hard-recipe/9", "format: "),
    ],
)
def test_bad_recipes(made: tuple[Path, str], tmp_path: Path, old: str, new: str, problem: str) -> None:
    recipe = next(made[0].glob("*/recipe.json")).read_text()
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "recipe.json").write_text(recipe.replace(old, new))
    found = run_command("generate", "--rebuild", tmp_path)
    assert found.exit_code == 2 and problem in found.output and recipe != recipe.replace(old, new)


def test_hard_options_need_hard_and_a_new_folder(made: tuple[Path, str], tmp_path: Path) -> None:
    plain = run_command("generate", "--category", "crosswalk", "--budget", 8, "--out", tmp_path / "suite")
    assert plain.exit_code == 2 and "--budget goes only with --hard" in plain.output
    assert "--hard: expected --out, found none" in run_command("generate", "--hard").output
    there = run_command("generate", "--hard", "--out", made[0])
    assert there.exit_code == 2 and "expected a new or empty folder to write to, found something there" in there.output
    name = run_command("generate", "--hard", "--out", tmp_path / "a b")
    assert name.exit_code == 2 and "expected a folder name of letters, digits and _.+-" in name.output


def test_a_journal_of_another_search_is_refused(made: tuple[Path, str], tmp_path: Path) -> None:
    folder = made[0].with_name("suite.search")
    found = run_command("generate", "--hard", "--seed", 3, "--search-folder", folder, "--out", tmp_path / "suite")
    assert found.exit_code == 2 and "found one with another seed 0 (now 3); --fresh starts anew" in found.output


@pytest.fixture
def copy(made: tuple[Path, str], tmp_path: Path) -> Path:
    """A copy of the suite, to be spoiled."""
    return Path(shutil.copytree(made[0], tmp_path / "suite"))


def validated(folder: Path) -> tuple[int, str]:
    found = run_command("validate", folder, "--seeds", 1, "--workers", 1)
    return found.exit_code, found.output


def test_the_suite_is_valid_and_listed_with_its_certificates(copy: Path) -> None:
    names = [scenario.id for scenario in load_suite(str(copy))]
    code, said = validated(copy)
    assert code == 0 and f"{names[0]}: ok, omniscient 100 with 1 of 1 seeds; no need certified" in said
    assert "suite: 2 scenarios in 1 categories, 0 on dense corridors, 0 with a certificate of need that holds" in said
    listed = run_command("list", "scenarios", "--suite", copy).output
    assert listed.splitlines()[0].split()[-3:] == ["needed", "gain", "[s]"] and "0 of 2 hold" in listed
    (copy / NEED_FILE).unlink()
    assert validated(copy)[0] == 0 and "hidden: unknown" in run_command("list", "scenarios", "--suite", copy).output
    assert (
        "expected a suite with occlusion.json" in run_command("list", "scenarios", "--suite", copy, "--occluded").output
    )


def test_other_limits_than_those_of_the_reference_are_found(copy: Path) -> None:
    suite = load_suite(str(copy))
    first = suite.scenarios[0]
    limits = {ego.id: ego.time_limit_s or 0.0 for ego in first.egos}
    changed = set_time_limits(first, {name: limit + 1.0 for name, limit in limits.items()})
    save_suite(seal_suite(replace(suite, scenarios=(changed, *suite.scenarios[1:]))))
    code, said = validated(copy)
    ((name, limit),) = limits.items()
    rule = "1.5 x the time of omniscient + 2 s"
    assert code == 1
    assert f"{first.id}: time limit of CAV {name}: expected {limit:g} s, {rule}, found {limit + 1:g} s" in said
    assert "need.json: expected certificates of sha256:" in said and "reference_times.json: expected" in said
    assert run_command("generate", "--rebuild", copy).output.startswith(f"{first.id}: the recipe makes another file")


def _claim_need(path: Path) -> None:
    certificates = read_need(path.parent)
    assert certificates is not None
    first, *rest = certificates.certificates
    conflict = NeedConflict(
        ego="a",
        road_user="b",
        x=0.0,
        y=0.0,
        time_limit_s=1.0,
        required_speed=1.0,
        is_blind=True,
        is_blind_over_roofs=False,
        cautious_s=None,
        cautious_speed=None,
        excludes_all=False,
        conflict_s=1.0,
    )
    forged = first.model_copy(update={"conflicts": (conflict,)})
    save_need(path.parent, certificates.model_copy(update={"certificates": (forged, *rest)}))


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (_claim_need, "need.json: expected what was just found, found otherwise for toy_"),
        (
            lambda path: path.write_text(path.read_text().replace("sha256:", "sha256:0")),
            "need.json: expected certificates of sha256:",
        ),
    ],
)
def test_certificates_that_are_not_true_are_found_and_written_anew(
    copy: Path, spoil: Callable[[Path], object], problem: str
) -> None:
    before = (copy / NEED_FILE).read_bytes()
    spoil(copy / NEED_FILE)
    code, said = validated(copy)
    assert code == 1 and problem in said
    assert run_command("validate", copy, "--seeds", 1, "--workers", 1, "--write").exit_code == 0
    assert (copy / NEED_FILE).read_bytes() == before


def test_the_packaged_suite_needs_its_numbers(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    suite = load_suite(str(copy))
    named = replace(suite, about=suite.about.model_copy(update={"name": "hard"}))
    problems = list(find_hard_problems(named, (), "", must_be_complete=True))
    assert [problem.partition(", found")[0] for problem in problems] == [
        "need.json: expected certificates of " + named.checksum()[:19] + "...",
        "expected 120 scenarios or more",
        "expected 10 categories or more",
        "expected 80 certificates of need that hold",
        "expected a third of 2 scenarios on dense corridors",
    ]
    (copy / NEED_FILE).unlink()
    assert "expected need.json" in next(find_hard_problems(named, (), "", must_be_complete=True))
    assert not list(find_hard_problems(named, (), "", must_be_complete=False))
