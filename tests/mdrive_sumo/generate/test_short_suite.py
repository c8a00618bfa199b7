"""Short suites: they keep the means of agents, name scenarios of their parts, and say what is wrong with them."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from testing.season_suites import write_season
from testing.worlds import straight_ego, straight_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.short_suite import choose_scenarios, compare_rankings, split_count
from mdrive_sumo.scenario.suite import Suite, load_suite, load_suite_of_one
from tools import build_short_suite
from tools.build_short_suite import build_suite

BUCKETS = {f"a{k}": "A" for k in range(6)} | {f"b{k}": "B" for k in range(12)}


def draw_scores(seed: int) -> dict[str, dict[str, float]]:
    rng = np.random.default_rng(seed)
    return {f"agent{k}": {name: float(rng.uniform(0, 100)) for name in BUCKETS} for k in range(3)}


def test_buckets_keep_their_shares() -> None:
    assert split_count(BUCKETS, 6) == {"A": 2, "B": 4}
    paper = ["InterDrive"] * 46 + ["Interaction"] * 112 + ["V2XPnP"] * 67
    numbers = split_count({f"s{k}": bucket for k, bucket in enumerate(paper)}, 40)
    assert numbers == {"InterDrive": 8, "Interaction": 20, "V2XPnP": 12}


@pytest.mark.parametrize("seed", range(4))
def test_no_exchange_of_two_scenarios_comes_nearer(seed: int) -> None:
    scores = draw_scores(seed)
    chosen = choose_scenarios(scores, BUCKETS, 6)
    assert len(chosen) == 6 and chosen == sorted(chosen, key=[*BUCKETS].index)

    def measure(names: list[str]) -> float:
        means = [(np.mean([of[name] for name in names]), np.mean([of[name] for name in BUCKETS if name[0] == "b"]))
                 for of in scores.values()]  # fmt: skip
        return float(sum((short - whole) ** 2 for short, whole in means))

    ours = [name for name in chosen if name[0] == "b"]
    others = [name for name in BUCKETS if name[0] == "b" and name not in ours]
    for out, new in itertools.product(ours, others):
        assert measure([new if name == out else name for name in ours]) >= measure(ours) - 1e-9


def test_all_scenarios_keep_the_ranking_and_none_cannot() -> None:
    scores = draw_scores(9)
    assert compare_rankings(scores, choose_scenarios(scores, BUCKETS, 18), BUCKETS) == 1.0
    with pytest.raises(InputError, match="expected 1 to 18 scenarios, found 19"):
        choose_scenarios(scores, BUCKETS, 19)


@pytest.fixture
def whole(tmp_path: Path) -> Suite:
    """A whole season of three scenarios, beside which a suite of one's own may lie."""
    return write_season(tmp_path, 7, straight_scenario(straight_ego("0")))


def test_a_short_suite_has_the_named_scenarios_of_its_parts(whole: Suite) -> None:
    made = build_suite(whole, ["v2xpnp_7", "interdrive_7"], whole.folder.with_name("mdrive-2"))
    assert [scenario.id for scenario in made] == ["interdrive_7", "v2xpnp_7"] and made.season == 7
    assert made.label == "mdrive-2@7" and len(made.parts) == 3
    assert load_suite_of_one(made.folder, "v2xpnp_7").label == made.label


def test_a_dry_run_says_how_well_the_choice_holds_and_writes_nothing(
    whole: Suite, monkeypatch: pytest.MonkeyPatch
) -> None:
    scores = {f"agent{k}": {scenario.id: 30.0 * k + n for n, scenario in enumerate(whole)} for k in range(2)}
    monkeypatch.setattr(build_short_suite, "load_scores", lambda places, suite: scores)
    out = whole.folder.with_name("mdrive-1")
    command = [str(whole.folder), "--suite", str(whole.folder), "--count", "1", "--out", str(out)]
    told = CliRunner().invoke(build_short_suite.main, [*command, "--dry-run"])
    assert told.exit_code == 0 and not out.exists(), told.output
    assert f"{out}: 1 scenarios would be written; Kendall's tau of 2 agents 1.000" in told.output
    told = CliRunner().invoke(build_short_suite.main, command)
    assert told.exit_code == 0 and len(load_suite(str(out))) == 1, told.output


@pytest.mark.parametrize(
    ("changed", "problem"),
    [
        ({"only": ["no-such"]}, "only: expected ids of scenarios of .*, found 'no-such'"),
        ({"only": ["a"], "parts": []}, "only: expected none in a suite without parts, found 'a'"),
    ],
)
def test_a_suite_that_names_what_is_not_there(whole: Suite, changed: dict[str, object], problem: str) -> None:
    made = build_suite(whole, [whole[0].id], whole.folder.with_name("mdrive-1"))
    path = made.folder / "suite.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changed))
    with pytest.raises(InputError, match=problem):
        load_suite(str(made.folder))
