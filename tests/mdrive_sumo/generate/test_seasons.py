"""Seasons: seeds, composition, selection, bad input; a small one is drawn, continued and rebuilt by the command."""

import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.category_requirements import INTERDRIVE
from mdrive_sumo.generate.drawn_places import CHOICES, CHOICES_AT_SIGNALS, draw_fitting_network, list_choices
from mdrive_sumo.generate.interdrive_proposer import propose_interdrive
from mdrive_sumo.generate.network_choice import is_suitable
from mdrive_sumo.generate.pipeline import build_scenario
from mdrive_sumo.generate.recipe import GENERATOR, SEASON_GENERATOR, Recipe, load_recipe, save_recipe
from mdrive_sumo.generate.rules import find_rule_violations
from mdrive_sumo.generate.seasons import draw_season as draw_season_module
from mdrive_sumo.generate.seasons import season_plan
from mdrive_sumo.generate.seasons.season_candidate import SeasonTask, evaluate_candidate
from mdrive_sumo.generate.seasons.season_plan import INTERDRIVE_COUNTS, SeasonGroup, Selection, list_selections
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed, parse_season
from mdrive_sumo.generate.selection import SelectionItem, compute_means, find_deviations, select_items
from mdrive_sumo.generate.start_shift import FURTHEST_M, find_start_shift
from mdrive_sumo.generate.validation.rule_coverage import find_exercised_rules
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.categories import FIGURES, InterDriveCategory
from mdrive_sumo.scenario.start_variation import shift_start
from mdrive_sumo.scenario.statistics import PAPER
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.worlds.network_features import Topology
from mdrive_sumo.worlds.places import draw_place

SECRET = "battery horse staple correct"
GROUP = SeasonGroup("interdrive", InterDriveCategory.STRAIGHT, 1, 2)


def command(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def refusal(*arguments: object) -> str:
    found = command("generate", *arguments)
    assert found.exit_code == 2, found.output
    return found.output


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_season_has_the_composition_of_the_benchmark() -> None:
    counts = {
        bucket: sum(group.count for selection in list_selections(bucket) for group in selection.groups)
        for bucket in ("interdrive", "interaction")
    }
    assert counts == {"interdrive": PAPER["interdrive"].scenarios, "interaction": PAPER["interaction"].scenarios}
    cavs = sum(cavs * count for numbers in INTERDRIVE_COUNTS.values() for cavs, count in numbers.items())
    assert cavs == PAPER["interdrive"].cavs


def test_interdrive_has_the_categories_of_season_0() -> None:
    found = Counter((scenario.category, len(scenario.egos)) for scenario in load_suite("interdrive@0"))
    plan = {(str(category), cavs): n for category, counts in INTERDRIVE_COUNTS.items() for cavs, n in counts.items()}
    assert found == plan


@pytest.mark.parametrize("category", INTERDRIVE)
def test_every_proposal_of_interdrive_keeps_the_rules(category: InterDriveCategory) -> None:
    requirements = INTERDRIVE[category]
    for cavs in range(requirements.cav_range[0], requirements.cav_range[1] + 1):
        for seed in range(20):
            topology = requirements.road.topologies[seed % len(requirements.road.topologies)]
            proposal = propose_interdrive(category, cavs, topology, Random(seed))
            assert len(proposal.ego_vehicles) == cavs
            assert find_rule_violations(proposal) == ()
            assert not proposal.actors


def test_number_season_and_secret_change_every_seed() -> None:
    seeds = [SeasonSeed(1), SeasonSeed(2), SeasonSeed(1, SECRET), SeasonSeed(1, SECRET + "!")]
    derived = {seed.derive("interdrive", "ins_ss", number) for seed in seeds for number in range(50)}
    assert len(derived) == 200
    assert not any(SECRET in str(seed.describe()) for seed in seeds)
    assert len({str(seed.describe()) for seed in seeds}) == 4


def test_a_secret_season_is_no_public_one() -> None:
    assert parse_season("3").season == 3
    assert parse_season("3", SECRET).season == "secret-3"
    assert parse_season("spring", SECRET).season == "spring"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("0", "expected a number from 1 to 9999, found that of the packaged suites"),
        ("spring", "expected a number, found a word, which needs --secret"),
        ("-1", "expected a number from 1 to 9999, or with --secret a word"),
        ("12345", "expected a number from 1 to 9999, or with --secret a word"),
        ("a b", "expected a number from 1 to 9999, or with --secret a word"),
    ],
)
def test_other_names_of_seasons_are_refused(text: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        parse_season(text)


def item(number: int, group: str, route_m: float) -> SelectionItem:
    return SelectionItem(f"s{number}", group, 2, 2 * route_m, 2 * route_m, 0, f"n{number}", f"d{number}")


def test_the_selection_keeps_the_groups_and_comes_near_to_the_means() -> None:
    rng = Random(1)
    pool = [item(n, "ab"[n % 2], rng.uniform(30.0, 90.0)) for n in range(40)]
    chosen = select_items(pool, {"a": 5, "b": 3}, (None, 50.0, 50.0, None), Random(0))
    assert Counter(one.group for one in chosen) == {"a": 5, "b": 3}
    assert max(map(abs, find_deviations(compute_means(chosen), (None, 50.0, 50.0, None)))) < 0.02
    assert chosen == select_items(pool, {"a": 5, "b": 3}, (None, 50.0, 50.0, None), Random(0))


def test_the_selection_has_as_many_hidden_conflicts_as_wanted() -> None:
    pool = [replace(item(n, "a", 50.0 + n % 3), is_hidden=n % 5 == 0) for n in range(40)]
    chosen = select_items(pool, {"a": 10}, (None, 50.0, 50.0, None), Random(0), least_hidden=6)
    assert sum(one.is_hidden for one in chosen) >= 6


def test_a_common_shift_leaves_the_run_up_to_a_conflict() -> None:
    (scenario,) = load_suite("interdrive@0").select("i19_ins_sr_minor_road")
    roads = load_road_map(find_network_folder(scenario.network))
    shift = find_start_shift(scenario.egos, (), roads)
    assert shift is not None
    assert shift.back_m == FURTHEST_M
    assert shift.ahead_m == FURTHEST_M  # they start 36 and 38 m before their lines
    near = [shift_start(ego, 25.0, roads) for ego in scenario.egos]
    nearer = find_start_shift(near, (), roads)
    assert nearer is not None and nearer.ahead_m < FURTHEST_M


@pytest.mark.slow
def test_a_candidate_is_the_same_again_and_another_with_a_secret(tmp_path: Path) -> None:
    kept: dict[str, dict[str, bytes]] = {}
    for name, seed in (("one", SeasonSeed(1)), ("again", SeasonSeed(1)), ("secret", SeasonSeed(1, SECRET))):
        outcomes = (evaluate_candidate(SeasonTask(seed, GROUP, number, tmp_path / name)) for number in range(9))
        assert any(outcome.item is not None for outcome in outcomes)
        kept[name] = contents(tmp_path / name)
    assert kept["one"] == kept["again"]
    assert not {*kept["one"]} & {*kept["secret"]}
    assert not any(SECRET.encode() in data for data in kept["secret"].values())


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Seasons of one scenario of InterDrive from a pool of two."""
    one = Selection("interdrive", (GROUP,), (None, 50.0, 10.0, None))
    monkeypatch.setattr(draw_season_module, "list_selections", lambda *_: [one])
    monkeypatch.setattr(season_plan, "POOL_FACTORS", {"interdrive": 2})
    yield


@pytest.mark.slow
@pytest.mark.usefixtures("tiny")
def test_a_season_is_drawn_continued_and_rebuilt(tmp_path: Path) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    for out, workers in ((first, 2), (again, 1)):
        drawn = command("generate", "--season", 7, "--bucket", "interdrive", "--out", out, "--workers", workers)
        assert drawn.exit_code == 0, drawn.output
    assert contents(first) == contents(again)
    suite = load_suite(str(first / "interdrive"))
    (scenario,) = suite.scenarios
    assert (suite.about.season, scenario.category, len(scenario.egos)) == (7, "ins_ss", 2)
    assert (first / "interdrive" / "networks" / scenario.network / "place.json").is_file()

    shutil.rmtree(first)
    before = (tmp_path / "first.work" / "interdrive" / "journal.jsonl").read_bytes()
    drawn = command("generate", "--season", 7, "--bucket", "interdrive", "--out", first)
    assert drawn.exit_code == 0 and "continuing: the journal holds" in drawn.output
    assert (tmp_path / "first.work" / "interdrive" / "journal.jsonl").read_bytes() == before
    assert contents(first) == contents(again)

    drawn = command("generate", "--season", 7, "--bucket", "interdrive", "--out", first)
    assert drawn.exit_code == 0 and "continuing" not in drawn.output  # what is there is not drawn again
    assert contents(first) == contents(again)

    told = command("generate", "--rebuild", first / "interdrive")
    assert told.exit_code == 0 and told.output.startswith("1 of 1 scenarios are as their recipes make them")
    told = command("generate", "--rebuild", first / "interdrive", "--out", tmp_path / "rebuilt")
    assert told.exit_code == 0 and contents(tmp_path / "rebuilt") == contents(first / "interdrive")
    network = first / "interdrive" / "networks" / scenario.network / "network.json"
    network.write_text(network.read_text() + "\n")
    told = command("generate", "--rebuild", first / "interdrive")
    assert told.exit_code == 1 and f"{scenario.id}: the recipe makes another file" in told.output

    recipe = first / "interdrive" / scenario.id / "recipe.json"
    place = load_recipe(recipe).place
    assert place is not None
    recipe.write_text(recipe.read_text().replace(f'"version":{place.version}', '"version":99'))
    assert "place: expected version" in refusal("--rebuild", first / "interdrive")

    shutil.rmtree(first)
    assert "expected a run of this command, found one with another season" in refusal(
        "--season", 8, "--bucket", "interdrive", "--out", first
    )


def test_options_of_a_season_are_checked(tmp_path: Path) -> None:
    short = tmp_path / "short"
    short.write_text("a secret")
    (tmp_path / "used" / "interdrive").mkdir(parents=True)
    (tmp_path / "used" / "interdrive" / "file").write_text("")
    assert "--season: expected --out, found none" in refusal("--season", 1)
    assert "--category goes not with --season" in refusal("--season", 1, "--category", "crosswalk", "--out", tmp_path)
    assert "--bucket goes only with --season" in refusal("--category", "crosswalk", "--bucket", "v2xpnp")
    assert "expected a private seed of 16 characters or more, found 8" in refusal(
        "--season", 1, "--secret", short, "--out", tmp_path / "new"
    )
    assert "found no file to read" in refusal("--season", 1, "--secret", tmp_path / "none", "--out", tmp_path / "new")
    assert "expected a new or empty folder to write to" in refusal("--season", 1, "--out", tmp_path / "used")
    assert not (tmp_path / "new").exists()


def test_without_netconvert_a_season_ends_with_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def find_none() -> Path:
        raise InputError("netconvert: expected SUMO's programs, found none")

    monkeypatch.setattr(draw_season_module, "find_netconvert", find_none)
    assert "netconvert: expected SUMO's programs" in refusal("--season", 1, "--out", tmp_path / "new")
    assert [*tmp_path.iterdir()] == []


def test_figures_of_all_categories_are_searched() -> None:
    assert [selection.name for selection in list_selections("interaction")] == list(map(str, FIGURES))


def test_a_stated_share_of_each_bucket_is_at_running_signals() -> None:
    for bucket, share in (("interdrive", 4), ("interaction", 10)):
        groups = [group for selection in list_selections(bucket) for group in selection.groups]
        assert sum(group.count for group in groups if group.at_signals) == share
        assert len({group.name for group in groups}) == len(groups)


@pytest.mark.slow
def test_places_have_signals_exactly_where_they_run() -> None:
    for choices, has_signals in ((CHOICES, False), (CHOICES_AT_SIGNALS, True)):
        for choice in {str(one): one for options in choices.values() for one in options}.values():
            draft = draw_place(choice.kind, 5, **choice.parameters).draft
            assert draft is not None
            assert any(node.type == "traffic_light" for node in draft.nodes) == has_signals, choice


def test_a_candidate_at_signals_meets_them(tmp_path: Path) -> None:
    proposal = propose_interdrive(InterDriveCategory.ONCOMING_LEFT, 3, Topology.INTERSECTION, Random(2))
    choices = list_choices(proposal, at_signals=True)
    place, roads = draw_fitting_network(choices, lambda features: is_suitable(features, proposal), "a", tmp_path)
    recipe = Recipe(generator=SEASON_GENERATOR, id="left", seed="a", proposal=proposal, signals="program", place=place)
    scenario = build_scenario(recipe, roads=roads)
    assert scenario.signals == "program" and "red-light" in find_exercised_rules(scenario, roads)
    save_recipe(recipe, tmp_path / "recipe.json")
    assert load_recipe(tmp_path / "recipe.json") == recipe
    save_recipe(recipe.model_copy(update={"generator": GENERATOR}), tmp_path / "old.json")
    with pytest.raises(InputError, match=f"expected version {SEASON_GENERATOR} of the generator, found {GENERATOR}"):
        load_recipe(tmp_path / "old.json")
