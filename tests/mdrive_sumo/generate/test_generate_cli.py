"""`mdrive-sumo generate` as a user calls it: suites that drive and can be made again; public and hidden splits."""

import json
import random
from collections.abc import Callable, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from testing.negotiation_fakes import completion, served

from mdrive_sumo.cli import main
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.duplicates import DUPLICATE_DISTANCE, scenario_distance
from mdrive_sumo.generate.generated_suite import load_packaged_generated
from mdrive_sumo.generate.generation_search import GenerationRequest, build_public_counterparts
from mdrive_sumo.generate.recipe import load_recipe
from mdrive_sumo.generate.template_proposer import propose
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture, pytest.mark.usefixtures("in_process")]

FAST = Category.PRE_CRASH
SECRET, OTHER = "battery horse staple correct", "one two three four"
"""Of which scenarios come that end soon."""
SEED = 19
"""Of which the first proposal is refused."""
Made = Mapping[str, tuple[Path, str]]
"""By name, suite folder and what was printed."""


def command(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def generated(out: Path, *more: object, category: Category = FAST) -> str:
    count = () if "--count" in more else ("--count", 2)
    found = command("generate", "--category", category, *count, "--out", out, *more)
    assert found.exit_code == 0, found.output
    return found.output


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def scenarios(folder: Path) -> tuple[Scenario, ...]:
    return load_suite(str(folder)).scenarios


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Suites of one or two scenarios; all have the same folder name, which is in `suite.json`."""
    home = tmp_path_factory.mktemp("generated")
    for name, secret in (("secret", SECRET), ("with a line end", f"{SECRET}\r\n"), ("other", OTHER)):
        (home / name).write_text(secret)
    hidden = ("--seed", SEED, "--count", 1, "--split", "hidden", "--seed-file")
    orders: dict[str, tuple[object, ...]] = {
        "public": ("--seed", SEED, "--explain"),
        "public other": ("--seed", SEED + 3, "--count", 1),
        "hidden": (*hidden, home / "secret"),
        "hidden again": (*hidden, home / "with a line end"),
        "hidden other": (*hidden, home / "other"),
    }
    folders = {name: home / f"of {name}" / "suite" for name in orders}
    return {name: (folders[name], generated(folders[name], *order)) for name, order in orders.items()}


@pytest.fixture
def copy(made: Made, tmp_path: Path) -> Callable[[str], Path]:
    """A copy of a suite, to be spoiled."""

    def copied(name: str) -> Path:
        for path, data in contents(made[name][0]).items():
            (tmp_path / name / path).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name / path).write_bytes(data)
        return tmp_path / name

    return copied


def test_a_suite_is_written_sealed_with_its_recipes(made: Made) -> None:
    assert made["hidden"][1] == f"1 of 1 scenarios: {made['hidden'][0]}\n"
    folder, said = made["public"]
    assert said.splitlines()[-1] == f"2 of 2 scenarios: {folder}"
    suite = load_suite(str(folder))
    assert len(suite.scenarios) == 2 and {scenario.category for scenario in suite.scenarios} == {FAST}
    assert suite.about.checksum == suite.checksum()
    assert {path.name for path in folder.glob("*/*")} == {"scenario.json", "recipe.json"}
    assert sorted(path.name for path in folder.parent.iterdir()) == ["suite"]  # no scratch is left


def test_the_same_seed_makes_the_same_bytes(made: Made) -> None:
    assert contents(made["hidden"][0]) == contents(made["hidden again"][0])


@pytest.mark.parametrize(("one", "two"), [("public", "public other"), ("hidden", "hidden other"), ("public", "hidden")])
def test_another_seed_or_secret_makes_other_scenarios(made: Made, one: str, two: str) -> None:
    pairs = list(product(scenarios(made[one][0]), scenarios(made[two][0])))
    assert all(a.id != b.id and scenario_distance(a, b) > 0 for a, b in pairs)


def test_explain_tells_every_proposal_and_how_many_each_stage_refused(made: Made) -> None:
    said = made["public"][1].splitlines()
    refused = [line for line in said if ": refused at " in line]
    assert [line.split(":")[0] for line in said[:-2]] == [f"proposal {n}" for n in range(len(said) - 2)]
    assert refused and all("expected" in line and "found" in line for line in refused)
    assert said[-2].startswith(f"refused of {len(said) - 2} proposals: ")
    counts = [part.split(" at ") for part in said[-2].partition("proposals: ")[2].split(", ")]
    assert sum(int(count) for count, _ in counts) == len(refused) == len(said) - 2 - 2
    for count, stage in counts:
        assert sum(f": refused at {stage}: " in line for line in refused) == int(count)


def test_a_generated_suite_can_be_driven(made: Made, tmp_path: Path) -> None:
    run = ("--agent", "constant-speed", "--workers", 1, "--no-record", "--out", tmp_path / "run")
    found = command("eval", "--suite", made["public"][0], *run)
    assert found.exit_code == 0, found.output
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    assert [one["status"] for one in results["scenarios"]] == ["ok", "ok"]


def test_rebuild_finds_everything_as_it_was(made: Made) -> None:
    found = command("generate", "--rebuild", made["public"][0])
    assert (found.exit_code, found.output) == (0, "2 of 2 scenarios are as their recipes make them\n")


def test_rebuild_writes_the_same_suite(made: Made, tmp_path: Path) -> None:
    found = command("generate", "--rebuild", made["hidden"][0], "--out", tmp_path / "new")
    assert found.exit_code == 0
    assert contents(tmp_path / "new") == contents(made["hidden"][0])


def _edited(path: Path) -> None:
    path.write_text(path.read_text().replace('"weather":"', '"weather": "', 1))


def _emptied(path: Path) -> None:
    path.write_text("")


@pytest.mark.parametrize("spoil", [_edited, _emptied, Path.unlink])
def test_rebuild_names_the_scenario_that_was_changed(
    copy: Callable[[str], Path], spoil: Callable[[Path], object]
) -> None:
    folder = copy("public")
    changed = sorted(path.name for path in folder.glob("*/"))[1]
    spoil(folder / changed / "scenario.json")
    found = command("generate", "--rebuild", folder)
    assert found.exit_code == 1
    assert found.output == (
        f"{changed}: the recipe makes another file\n1 of 2 scenarios are as their recipes make them\n"
    )


def test_hidden_scenarios_are_neither_public_ones_nor_like_any(made: Made) -> None:
    order = GenerationRequest(FAST, 2, SEED, "hidden", SECRET)
    public = [*load_packaged_generated(), *scenarios(made["public"][0]), *build_public_counterparts(order)]
    ids = [scenario.id for scenario in public]
    assert set(ids) > {scenario.id for scenario in scenarios(made["public"][0])}
    for scenario in scenarios(made["hidden"][0]):
        assert scenario.id.startswith(f"{FAST}_h") and scenario.id not in ids
        assert min(scenario_distance(scenario, other) for other in public) >= DUPLICATE_DISTANCE


def test_what_may_be_in_the_public_split_is_made_without_the_secret(made: Made) -> None:
    counterparts = {
        scenario.id: scenario
        for scenario in build_public_counterparts(GenerationRequest(FAST, 2, SEED, "hidden", SECRET))
    }
    for scenario in scenarios(made["public"][0]):
        assert scenario_distance(counterparts[scenario.id], scenario) == 0.0
    assert set(counterparts) == {
        one.id for one in build_public_counterparts(GenerationRequest(FAST, 2, SEED, "hidden", OTHER))
    }


def test_hidden_files_do_not_hold_the_secret(made: Made) -> None:
    files = contents(made["hidden"][0])
    text = b"".join((name.encode() + data for name, data in files.items())).decode()
    for word in (SECRET, *SECRET.split(), SECRET.encode().hex()):
        assert word not in text
    recipe = json.loads(next(data for name, data in files.items() if name.endswith("recipe.json")))
    assert len(recipe["seed"]) == 24 and int(recipe["seed"], 16) >= 0  # a hash


class Writer:
    """A model that proposes a new template for every conversation, the first time with a mistake."""

    def __init__(self) -> None:
        self.proposals: dict[str, str] = {}

    def __call__(self, request: dict[str, Any]) -> tuple[int, bytes]:
        asked = request["messages"][1]["content"]
        proposal = propose(FAST, random.Random(asked))
        if asked in self.proposals:
            return 200, completion(self.proposals[asked])
        self.proposals[asked] = proposal.model_dump_json()
        return 200, completion(proposal.model_copy(update={"ego_vehicles": ()}).model_dump_json())


def test_a_model_proposes_and_its_transcripts_make_the_same_suite_again(tmp_path: Path) -> None:
    model = ("--proposer", "llm", "--seed", 2, "--count", 1)
    writer = Writer()
    with served(writer) as service:
        live = ("--endpoint", service.url, "--model", "writer-7b", "--transcripts", tmp_path / "kept")
        generated(tmp_path / "live" / "suite", *model, *live)
    suite = load_suite(str(tmp_path / "live" / "suite"))
    assert "llm:writer-7b" in suite.about.description
    recipes = [load_recipe(suite.folder / scenario.id / "recipe.json") for scenario in suite.scenarios]
    assert {recipe.proposer for recipe in recipes} == {"llm:writer-7b"}
    assert all(recipe.proposal.model_dump_json() in writer.proposals.values() for recipe in recipes)
    generated(tmp_path / "again" / "suite", *model, "--replay", tmp_path / "kept")
    assert contents(tmp_path / "again" / "suite") == contents(suite.folder)
    assert command("generate", "--rebuild", suite.folder).exit_code == 0


@pytest.mark.full  # the others of this file generate pre-crash
@pytest.mark.parametrize("category", Category)
def test_every_category_is_generated_rebuilt_and_driven(category: Category, tmp_path: Path) -> None:
    generated(tmp_path / "suite", "--seed", 11, category=category)
    assert command("generate", "--rebuild", tmp_path / "suite").exit_code == 0
    run = ("--agent", "constant-speed", "--workers", 1, "--no-record", "--out", tmp_path / "run")
    found = command("eval", "--suite", tmp_path / "suite", *run)
    assert found.exit_code == 0, found.output
