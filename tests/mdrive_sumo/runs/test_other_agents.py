"""Runs of two agents: which CAVs are under test, whose scores stand where, resume, verify, bad input."""

import json
from pathlib import Path

import pytest
from click.testing import Result
from hypothesis import given
from hypothesis import strategies as st
from testing.local_executor import TALKER
from testing.short_suite import make_short_suite
from testing.study_samples import invoke

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.other_agents import OtherAgents, count_tested, parse_other_agents
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import Results, load_results

SCENARIO = max(load_suite("interdrive@0"), key=lambda scenario: len(scenario.egos))


@given(cavs=st.integers(1, 20), penetration=st.integers(1, 99))
def test_the_number_under_test_is_the_share_rounded_half_up(cavs: int, penetration: int) -> None:
    count = count_tested(cavs, penetration)
    assert 1 <= count <= cavs
    assert abs(count - cavs * penetration / 100) <= 0.5 or count == 1
    assert count_tested(cavs, min(99, penetration + 1)) >= count


@given(seed=st.integers(0, 1000), lower=st.integers(1, 99), higher=st.integers(1, 99))
def test_a_higher_penetration_keeps_the_cavs_of_a_lower_one(seed: int, lower: int, higher: int) -> None:
    chosen = [OtherAgents(AgentSpec("idm"), level).choose_tested(SCENARIO, seed) for level in sorted((lower, higher))]
    assert chosen[0] <= chosen[1] <= {ego.id for ego in SCENARIO.egos}


def test_seeds_draw_different_cavs_of_which_one_is_under_test() -> None:
    drawn = [OtherAgents(AgentSpec("idm")).choose_tested(SCENARIO, seed) for seed in range(100)]
    assert {len(one) for one in drawn} == {1}
    assert {ego for one in drawn for ego in one} == {ego.id for ego in SCENARIO.egos}


def test_penetration_alone_means_that_the_others_drive_by_themselves() -> None:
    assert parse_other_agents(None, None) is None
    assert parse_other_agents(None, 50) == OtherAgents(AgentSpec("single"), 50)
    assert parse_other_agents("idm", None) == OtherAgents(AgentSpec("idm"), None)
    with pytest.raises(InputError, match=r"penetration: expected a whole number from 1 to 99 \[percent\], found 100"):
        parse_other_agents("idm", 100)


def evaluate(folder: Path, *more: str | Path, others: str = "stationary") -> Result:
    suite = folder / "suite"
    if not suite.exists():
        make_short_suite(suite, "i01*")
    words = ("eval", "--suite", suite, "--agent", TALKER, "--others", others, "--out", folder / "run")
    return invoke(*words, "--workers", "1", *more)


@pytest.fixture(scope="module")
def run(in_process: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("two")
    ended = evaluate(folder)
    assert ended.exit_code == 0, ended.output
    assert "(one CAV) among stationary" in ended.output
    return folder


def load(run: Path) -> Results:
    return load_results(run / "run" / "results.json")


@pytest.mark.slow
def test_each_agent_drives_its_cavs_and_has_its_scores(run: Path) -> None:
    results = load(run)
    (scenario,) = results.scenarios
    tested, other = sorted(scenario.egos, key=lambda ego: ego.is_other)
    assert (tested.is_other, other.is_other) == (False, True)
    assert tested.rc > 90.0 > 10.0 > other.rc, "a stationary agent goes nowhere"
    roles = results.overall.roles
    assert roles is not None and roles.others is not None
    assert (roles.tested.ds, roles.others.ds) == pytest.approx((tested.ds, other.ds))
    assert (results.run.others, results.run.penetration) == ("stationary", None)
    assert "| stationary | other | 1 |" in (run / "run" / "report.md").read_text()


@pytest.mark.slow
def test_the_run_is_continued_verified_and_scored_anew(run: Path) -> None:
    assert "1/1" not in evaluate(run).output, "nothing is left to drive"
    assert invoke("verify", run / "run", "--workers", "1").exit_code == 0
    assert invoke("rescore", run / "run").exit_code == 0
    again = json.loads((run / "run" / "results-mdrive.json").read_text())
    assert again == json.loads((run / "run" / "results.json").read_text())


@pytest.mark.slow
def test_a_changed_role_is_found(run: Path, tmp_path: Path) -> None:
    page = json.loads((run / "run" / "results.json").read_text())
    page["overall"]["roles"]["tested"]["ds"] -= 1.0
    (tmp_path / "results.json").write_text(json.dumps(page))
    with pytest.raises(InputError, match=r"overall\.roles\.tested\.ds"):
        load_results(tmp_path / "results.json")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("others", "words", "sentence"),
    [
        ("idn", (), "agent 'idn': expected"),
        ("idm", (), "found one with another others stationary (now idm)"),
        ("stationary", ("--penetration", "100"), "100 is not in the range 1<=x<=99"),
        ("stationary", ("--penetration", "50"), "found one with another penetration none (now 50)"),
    ],
)
def test_bad_input_is_one_sentence(run: Path, others: str, words: tuple[str, ...], sentence: str) -> None:
    ended = evaluate(run, *words, others=others)
    assert (ended.exit_code, "Traceback" in ended.output) == (2, False)
    assert sentence in ended.output
