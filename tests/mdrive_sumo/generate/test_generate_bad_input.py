"""Bad input to the generator and its suites: one sentence with what, where, expected and found; exit code 2."""

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from testing.negotiation_fakes import completion, served

from mdrive_sumo.cli import main
from mdrive_sumo.generate import generation_search
from mdrive_sumo.generate.category_requirements import CATEGORIES, Category
from mdrive_sumo.generate.generated_suite import write_generated_suite
from mdrive_sumo.generate.pipeline import build_scenario
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.recipe import GENERATOR, Recipe, save_recipe
from mdrive_sumo.generate.template_proposer import propose
from mdrive_sumo.scenario.suite import SuiteFile
from tests.mdrive_sumo.generate.test_generate_rules import BROKEN, actor, deadlock, ego, other, relation

Fields = dict[str, Any]


def refusal(*arguments: object) -> str:
    """What the command says of input that it cannot use."""
    found = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert found.exit_code == 2, found.output
    assert found.output.count("\n") == 1 and found.output.startswith("Error: "), found.output
    return found.output.removeprefix("Error: ").strip()


def misuse(*arguments: object) -> str:
    """What the command says of options that it cannot use, usage left out."""
    found = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert found.exit_code == 2
    return found.output.partition("Error: ")[2].strip()


def generate(out: Path, *more: object) -> str:
    return refusal("generate", "--category", "crosswalk", "--count", 1, "--out", out, *more)


def rebuild(folder: Path, proposal: Proposal) -> str:
    """What is said of a recipe with that proposal."""
    save_recipe(Recipe(id="bad", seed="1", proposal=proposal), folder / "bad" / "recipe.json")
    return refusal("generate", "--rebuild", folder)


@pytest.mark.parametrize("rule", sorted(BROKEN))
def test_a_recipe_that_breaks_a_rule_is_refused_at_the_rules(rule: str, tmp_path: Path) -> None:
    proposal, sentence = BROKEN[rule]
    said = rebuild(tmp_path, proposal)
    assert said.startswith("recipe bad: refused at stage rules: ") and sentence in said


def test_constraints_that_contradict_each_other_in_a_circle_are_refused(tmp_path: Path) -> None:
    circle = [relation(2, "left_lane_of", 1), relation(3, "left_lane_of", 2), relation(1, "left_lane_of", 3)]
    said = rebuild(tmp_path, deadlock(vehicle_constraints=circle))
    assert said.startswith("recipe bad: refused at stage ways: network ")
    assert said.endswith(": expected ways that keep all relations, found none")


def test_a_topology_that_no_network_has_is_refused(tmp_path: Path) -> None:
    fields: Fields = {
        "pre_crash": 37,
        "topology": "two_lane_corridor",
        "needs_merge": True,
        "ego_vehicles": [ego(1), ego(2)],
        "vehicle_constraints": [relation(2, "merges_into_lane_of", 1)],
    }
    said = rebuild(tmp_path, other("pre-crash", **fields))
    assert said.startswith(
        "recipe bad: refused at stage crop: networks: expected one with the topology two_lane_corridor with merge,"
        " found none among "
    )


def test_a_goal_that_no_way_leads_to_is_refused(tmp_path: Path) -> None:
    turning = [ego(n, "left") for n in (1, 2, 3)]
    said = rebuild(
        tmp_path, other("blocked-lane", ego_vehicles=turning, vehicle_constraints=[relation(2, "left_lane_of", 1)])
    )
    assert said in {
        f"recipe bad: refused at stage ways: network {name}: expected ways that keep all relations, found none"
        for name in CATEGORIES[Category.BLOCKED_LANE].networks
    }


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """A suite with one scenario and its recipe; nothing is driven."""
    proposal = deadlock(actors=[actor("cone", motion="static", timing_phase="on_approach")])
    recipe = Recipe(id="deadlock_1", seed="1", proposal=proposal)
    write_generated_suite(SuiteFile(name="suite", title="One"), [(recipe, build_scenario(recipe))], tmp_path / "suite")
    return tmp_path / "suite"


def edit(suite: Path, change: Callable[[Fields], object], file: str = "scenario.json", unseal: bool = True) -> None:
    """Changes a file of the scenario, and takes the checksum off the suite so that the change itself is looked at."""
    path, about = suite / "deadlock_1" / file, suite / "suite.json"
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    if unseal:
        about.write_text(json.dumps(json.loads(about.read_text()) | {"checksum": ""}))


def drive(suite: Path) -> str:
    return refusal("eval", "--suite", suite, "--agent", "stationary", "--workers", 1, "--out", suite.parent / "run")


def test_a_goal_behind_a_gap_in_the_lanes_is_refused(suite: Path) -> None:
    edit(suite, lambda data: data["egos"][0].update(lanes=[data["egos"][0]["lanes"][0], data["egos"][0]["lanes"][-1]]))
    said = drive(suite)
    assert "scenario deadlock_1: ego 0: expected a lane after or beside " in said
    assert said.endswith(", which is not connected")


def test_spawns_that_overlap_are_refused(suite: Path) -> None:
    edit(suite, lambda data: data["actors"][0].update(start=data["egos"][0]["start"]))
    assert "scenario deadlock_1: actor cone: start: expected room, found CAV 0 there (" in drive(suite)


def test_a_trigger_on_an_unknown_vehicle_is_refused(suite: Path) -> None:
    walking = {"type": "path", "points": [[0.0, 0.0], [9.0, 0.0]], "speed": 1.0}
    setting_off = {"type": "distance_to_vehicle", "vehicle": "9"}
    edit(suite, lambda data: data["actors"][0].update(motion=walking, trigger=setting_off))
    assert drive(suite) == (
        f"{suite}/deadlock_1/scenario.json: the file: actor cone: expected one of the CAVs 0, 1, 2, 3, found '9'"
    )


def test_a_proposed_actor_that_affects_an_unknown_vehicle_is_refused(tmp_path: Path) -> None:
    said = rebuild(tmp_path, deadlock(actors=[actor(affects_vehicle="Vehicle 7")]))
    assert said.endswith("actor thing: affects_vehicle: expected one of the ego vehicles, found Vehicle 7")


def test_a_suite_whose_checksum_does_not_match_is_refused(suite: Path) -> None:
    edit(suite, lambda data: data.update(weather="rain"), unseal=False)
    said = drive(suite)
    assert said.startswith(f"{suite}/suite.json: checksum: expected scenarios and networks with sha256:")
    assert ", found sha256:" in said


@pytest.mark.parametrize("found", [GENERATOR + 1, 0])
def test_a_recipe_of_another_generator_is_refused(suite: Path, found: int) -> None:
    edit(suite, lambda data: data.update(generator=found), "recipe.json")
    wanted = f"{suite}/deadlock_1/recipe.json: expected version {GENERATOR} of the generator, found {found}"
    assert refusal("generate", "--rebuild", suite) == wanted


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"proposal": {"category": "ballet"}}, "proposal.category: expected one of pre-crash, "),
        ({"seed": ""}, "seed: String should have at least 1 character, found ''"),
        ({"colour": "red"}, "colour: Extra inputs are not permitted, found 'red'"),
    ],
)
def test_a_recipe_that_breaks_its_format_is_refused(suite: Path, change: Fields, sentence: str) -> None:
    edit(suite, lambda data: data.update(change), "recipe.json")
    assert refusal("generate", "--rebuild", suite).startswith(f"{suite}/deadlock_1/recipe.json: {sentence}")


def test_a_scenario_without_a_recipe_cannot_be_made_again(suite: Path) -> None:
    (suite / "deadlock_1" / "recipe.json").unlink()
    assert refusal("generate", "--rebuild", suite) == (
        f"{suite}/deadlock_1/recipe.json: expected a recipe to read, found none: No such file or directory"
    )


@pytest.mark.parametrize("name", ["nowhere", "."])
def test_a_folder_that_is_no_suite_cannot_be_made_again(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    said = refusal("generate", "--rebuild", name)
    assert said == f"suite '{name}': expected scenarios with recipes in <id>/recipe.json, found none"


def test_a_folder_with_something_in_it_is_not_written_to(suite: Path, tmp_path: Path) -> None:
    said = generate(suite)
    assert said == f"{suite}: expected a new or empty folder to write to, found something there"
    assert said == refusal("generate", "--rebuild", suite, "--out", suite)
    assert (suite / "deadlock_1" / "recipe.json").is_file()
    (tmp_path / "file").write_text("")
    assert "is a file" in misuse("generate", "--category", "crosswalk", "--out", tmp_path / "file")


@pytest.fixture
def no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is proposed: what is wrong shall be told before minutes have passed."""

    def search(*_: object) -> None:
        raise AssertionError("searched")

    monkeypatch.setattr("mdrive_sumo.cli.generate.search_scenarios", search)


@pytest.mark.usefixtures("no_search")
@pytest.mark.parametrize("name", ["my suite", "-x", "a" * 81, "ü"])
def test_a_folder_whose_name_is_no_name_of_a_suite_is_refused(name: str, tmp_path: Path) -> None:
    assert generate(tmp_path / name) == (
        f"--out {tmp_path / name}: expected a folder name of letters, digits and _.+- (at most 80), found {name!r}"
    )


@pytest.mark.usefixtures("no_search")
def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert generate(tmp_path / "file" / "out").startswith(f"{tmp_path}/file/out: cannot be written")
    assert generate(Path("/proc/out")).startswith("/proc/out: cannot be written")


def test_an_unknown_category_is_refused(tmp_path: Path) -> None:
    said = misuse("generate", "--category", "ballet", "--out", tmp_path / "out")
    assert said.startswith("Invalid value for '--category': expected one of pre-crash, ")


@pytest.mark.parametrize("options", [("--category", "crosswalk"), ("--out", "new"), ()])
def test_what_to_make_and_where_is_asked_for(options: tuple[str, ...]) -> None:
    assert misuse("generate", *options).startswith(
        "expected --category and --out (or --season, --hard or --rebuild), found none"
    )


@pytest.mark.parametrize("count", [0, 1001, "many"])
def test_a_count_out_of_range_is_refused(count: object, tmp_path: Path) -> None:
    said = misuse("generate", "--category", "crosswalk", "--out", tmp_path / "out", "--count", count)
    assert said.startswith("Invalid value for '--count': ")


HIDDEN = ("--split", "hidden", "--seed-file")
WANTED = "expected a private seed of 16 characters or more, found "


@pytest.mark.parametrize(
    ("text", "found"), [(b"", "0"), (b" fifteen letters \n", "15"), (b"\xff\xfe" * 20, "bytes that are no text")]
)
def test_a_private_seed_that_is_too_short_or_no_text_is_refused(text: bytes, found: str, tmp_path: Path) -> None:
    (tmp_path / "seed").write_bytes(text)
    assert generate(tmp_path / "out", *HIDDEN, tmp_path / "seed") == f"{tmp_path}/seed: {WANTED}{found}"


def test_a_private_seed_that_is_not_there_is_refused(tmp_path: Path) -> None:
    said = generate(tmp_path / "out", *HIDDEN, tmp_path / "seed")
    assert said == f"{tmp_path}/seed: {WANTED}no file to read: No such file or directory"


@pytest.mark.parametrize("split", ["hidden", "public"])
def test_hidden_split_and_seed_file_go_together(split: str, tmp_path: Path) -> None:
    (tmp_path / "seed").write_text("0123456789abcdef")
    more = ("--split", "hidden") if split == "hidden" else ("--seed-file", tmp_path / "seed")
    said = misuse("generate", "--category", "crosswalk", "--out", tmp_path / "out", *more)
    assert said == "expected --seed-file together with --split hidden, found one without the other"


def by_model(out: Path, *more: object) -> str:
    return generate(out, "--proposer", "llm", *more)


@pytest.mark.slow
def test_a_model_that_never_proposes_a_valid_one_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generation_search, "MAX_TRIES", 3)
    empty = propose(Category.CROSSWALK, random.Random(1)).model_copy(update={"actors": ()})
    with served(lambda _: (200, completion(empty.model_dump_json()))) as service:
        said = by_model(tmp_path / "out", "--endpoint", service.url, "--attempts", 2)
    assert said == (
        "crosswalk: expected a scenario from 3 proposals, found none (3 at rules); the last one:"
        " the language model never proposed a valid crosswalk; the last time: actors: expected at least one walker for"
        " crosswalk, found none"
    )
    assert len(service.requests) == 2 * 3
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_model_that_does_not_answer_ends_at_the_first_proposal(tmp_path: Path) -> None:
    with served(lambda _: (500, b"")) as service:
        said = by_model(tmp_path / "out", "--endpoint", service.url, "--attempts", 1)
    assert said.startswith("language model: expected a proposal for crosswalk, found no answer: ")
    assert len(service.requests) == 1


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ((), "option endpoint: expected the URL"),
        (
            ("--endpoint", "http://127.0.0.1:9", "--attempts", 11),
            "language model: attempts: expected 1 to 10, found 11",
        ),
        (("--endpoint", "http://127.0.0.1:9", "--timeout", 0), "language model: timeout_s: expected more than 0"),
        (("--endpoint", "http://127.0.0.1:9", "--temperature", 3), "language model: temperature: expected 0 to 2"),
        (("--replay", "/nowhere"), "--replay /nowhere: expected transcripts of an earlier run, found none"),
    ],
)
def test_settings_of_the_model_that_make_no_sense_are_refused(
    options: tuple[object, ...], sentence: str, tmp_path: Path
) -> None:
    assert sentence in by_model(tmp_path / "out", *options)
