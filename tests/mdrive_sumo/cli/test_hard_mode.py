"""Score mode `hard` from end to end: refused without reference times, the default of its suite, rescored, verified."""

from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.hard_suite import build_fast_scenario, make_hard_suite

from mdrive_sumo.cli import main
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import load_results
from mdrive_sumo.study.need_certificate import NeedCertificate, NeedCertificateFile, NeedConflict, Proof

pytestmark = [pytest.mark.usefixtures("in_process"), pytest.mark.slow]
REFERENCE = ("--agent", "omniscient", "--ids", "scenario", "--sensing", "perfect", "--score-mode", "mdrive")


def command(*words: str | int | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory, in_process: None) -> Path:
    """A suite with reference times."""
    folder = make_hard_suite(tmp_path_factory.mktemp("hard") / "suite")
    refused = command("eval", "--suite", folder, "--agent", "omniscient", "--workers", 1, "--out", folder / "no")
    assert refused.exit_code == 2
    assert "scenario fast_expressway: score mode hard: expected times of omniscient" in refused.output
    assert not (folder / "no").exists()
    reference = folder.parent / "reference"
    driven = command("eval", "--suite", folder, *REFERENCE, "--workers", 1, "--out", reference)
    assert driven.exit_code == 0, driven.output
    assert command("reference-times", reference).exit_code == 0
    return folder


def test_the_time_counts_and_the_creeping_car_pays(suite: Path, tmp_path: Path) -> None:
    crept = tmp_path / "creep.json"
    crept.write_text('{"speed_share": 0.25}')
    ran = command(
        "eval", "--suite", suite, "--agent", "single", "--agent-config", crept, "--workers", 1, "--out", tmp_path / "a"
    )
    assert ran.exit_code == 0, ran.output
    results = load_results(tmp_path / "a" / "results.json")
    (found,) = results.scenarios
    assert results.run.score_mode == "hard"
    assert "score mode hard" in ran.output
    assert [ego.ds for ego in found.egos] == [100.0, 100.0]
    assert found.sr == 100.0
    assert found.ds == pytest.approx(
        100 * sum(1 / ego.time_ratio for ego in found.egos if ego.time_ratio) / 2, abs=1e-3
    )
    assert found.ds < 45.0
    for mode, ds in (("mdrive", 100.0), ("hard", found.ds)):
        assert command("rescore", tmp_path / "a", "--score-mode", mode).exit_code == 0
        (again,) = load_results(tmp_path / "a" / f"results-{mode}.json").scenarios
        assert again.ds == ds
        assert all((ego.time_factor is None) == (mode == "mdrive") for ego in again.egos)
    verified = command("verify", tmp_path / "a")
    assert verified.exit_code == 0, verified.output
    assert "certificate proves" not in command("show", tmp_path / "a").output
    _certify(suite, found.id, found.egos[0].id)
    table = command("show", tmp_path / "a").output.split("certificate proves")[1].splitlines()
    assert table[2].split() == ["all", "1", "0", "0", "0", "1"]


def _certify(suite: Path, scenario: str, cav: str) -> None:
    """Write a certificate that says of a CAV what is not true: it arrived."""
    conflict = NeedConflict(
        ego=cav,
        road_user="b",
        x=0.0,
        y=0.0,
        required_speed=1.0,
        proves=Proof.ALL,
        proves_over_roofs=None,
        conflict_s=1.0,
    )
    certificate = NeedCertificate(scenario=scenario, conflicts=(conflict,))
    NeedCertificateFile.write(load_suite(str(suite)), {scenario: certificate})


@pytest.mark.parametrize("agent", ["constant-speed", "sharing+negotiation"])
def test_agents_drive_a_packaged_network_at_its_speed(agent: str, suite: Path, tmp_path: Path) -> None:
    ran = command("eval", "--suite", suite, "--agent", agent, "--workers", 1, "--out", tmp_path / "b")
    assert ran.exit_code == 0, ran.output
    (found,) = load_results(tmp_path / "b" / "results.json").scenarios
    assert found.sr == 100.0
    assert found.ds > 93.0
    assert 18.0 < (found.scalars["mean_speed"] or 0.0) < 23.0


@pytest.mark.full
@pytest.mark.parametrize(
    ("network", "lane", "speed"),
    [("motorway", "weave_3", 17.0), ("freeway", "before_1", 20.0), ("wide_crossing", "west_in_1", 12.0)],
)
@pytest.mark.parametrize("agent", ["omniscient", "sharing+negotiation"])
def test_other_networks_are_driven_at_their_speeds(
    agent: str, network: str, lane: str, speed: float, tmp_path: Path
) -> None:
    scenario = build_fast_scenario(network, lane, speed)
    folder = make_hard_suite(tmp_path / "suite", scenario)
    options = ("--suite", folder, "--agent", agent, "--score-mode", "mdrive", "--workers", 1)
    assert command("eval", *options, "--out", tmp_path / "c").exit_code == 0
    (found,) = load_results(tmp_path / "c" / "results.json").scenarios
    assert (found.ds, found.sr) == (100.0, 100.0)
    assert (found.scalars["mean_speed"] or 0.0) > 0.85 * speed
