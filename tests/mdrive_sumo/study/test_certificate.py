"""Occlusion certificates: which vehicle is hidden from which CAV on the way to a conflict."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from click.testing import CliRunner

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, reexecute
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.study import occlusion_certificate
from mdrive_sumo.study.occlusion_certificate import (
    OccludedInterval,
    OcclusionCertificate,
    OcclusionCertificateFile,
    find_occluded_intervals,
)

TOWN = load_road_map(find_network_folder("town_crossing"))


@cache
def blind(scenario: str) -> tuple[EpisodeRecord, Scenario]:
    job = EpisodeJob(find_suite_folder("interdrive@0"), scenario, AgentSpec("constant-speed"))
    found = next(s for s in load_suite("interdrive@0").scenarios if s.id == scenario)
    return reexecute(job), found


def hidden_in(scenario: str, **changes: object) -> tuple[OccludedInterval, ...]:
    episode, found = blind(scenario)
    return find_occluded_intervals("constant-speed", episode, found, replace(TOWN, **changes))


@pytest.mark.slow
def test_houses_hide_vehicles_from_the_side() -> None:
    intervals = hidden_in("i07_ins_ss_town")
    assert {(h.ego, h.actor) for h in intervals if h.matters} >= {("0", "1"), ("1", "0")}
    assert all(h.start_s <= h.end_s <= h.conflict_s for h in intervals)
    assert all(h.actor in h.by for h in intervals)  # a CAV can always tell of itself


def test_without_houses_no_vehicle_is_hidden() -> None:
    assert not any(h.matters for h in hidden_in("i07_ins_ss_town", buildings=()))


@pytest.mark.slow
def test_oncoming_traffic_in_plain_sight_is_not_hidden() -> None:
    assert not any(h.matters for h in hidden_in("i25_ins_oppo_boulevard"))


def test_a_road_side_unit_that_sees_the_hidden_one_is_named() -> None:
    episode, found = blind("i07_ins_ss_town")
    first = next(h for h in hidden_in("i07_ins_ss_town") if h.matters)
    column, tick = episode.ids.index(first.actor), round(first.start_s / 0.05)
    beside = RoadsideUnit(id="rsu", x=float(episode.x[tick, column]) + 4, y=float(episode.y[tick, column]))
    told = find_occluded_intervals("constant-speed", episode, found.model_copy(update={"rsus": (beside,)}), TOWN)
    again = next(h for h in told if (h.ego, h.actor, h.start_s) == (first.ego, first.actor, first.start_s))
    assert "rsu" in again.by


def interval(start_s: float, end_s: float, conflict_s: float, by: tuple[str, ...] = ("b",)) -> OccludedInterval:
    return OccludedInterval(
        drive="omniscient", ego="a", actor="b", start_s=start_s, end_s=end_s, conflict_s=conflict_s, by=by
    )


@pytest.mark.parametrize(
    ("hidden", "matters"),
    [
        (interval(0.0, 3.0, 4.0), True),
        (interval(0.0, 0.8, 2.0), False),  # too short to be told
        (interval(0.0, 3.0, 8.0), False),  # in plain sight long before it is needed
    ],
)
def test_an_interval_matters_if_it_is_long_and_late(hidden: OccludedInterval, matters: bool) -> None:
    assert hidden.matters is matters


def test_a_certificate_names_the_observers() -> None:
    alone = OcclusionCertificate(scenario="s", hidden=(interval(0.0, 3.0, 4.0), interval(0.0, 0.4, 1.0, ("b", "c"))))
    assert (alone.occluded, alone.longest_s, alone.by_third) == (True, 3.0, False)
    helped = OcclusionCertificate(scenario="s", hidden=(interval(0.0, 3.0, 4.0, ("b", "c")),))
    assert helped.by_third
    assert not OcclusionCertificate(scenario="s", hidden=()).occluded


def suite_in(folder: Path, *names: str, parts: tuple[str, ...] = ()) -> Suite:
    """A suite on disk with some of our scenarios, or with parts."""
    ours = tuple(s for s in load_suite("interdrive@0").scenarios if s.id in names)
    save_suite(Suite(SuiteFile(name=folder.name, title="", parts=parts), folder, ours))
    return load_suite(str(folder))


def keep(suite: Suite) -> OcclusionCertificate:
    made = OcclusionCertificate(scenario=suite.scenarios[0].id, hidden=(interval(0.0, 3.0, 4.0),))
    OcclusionCertificateFile(suite_checksum=suite.checksum(), certificates=(made, made)).save(suite.folder)
    return made


def test_certificates_are_kept_for_the_suite_they_were_made_for(tmp_path: Path) -> None:
    suite = suite_in(tmp_path / "a", "i07_ins_ss_town")
    assert OcclusionCertificateFile.load(suite) == {}
    made = keep(suite)
    assert OcclusionCertificateFile.load(suite) == {"i07_ins_ss_town": made}
    other = replace(suite, scenarios=(suite.scenarios[0].model_copy(update={"weather": "rain"}),))
    assert OcclusionCertificateFile.load(other) == {}


def test_a_suite_of_parts_has_the_certificates_of_each_that_did_not_change(tmp_path: Path) -> None:
    first = keep(suite_in(tmp_path / "a", "i07_ins_ss_town"))
    second = keep(suite_in(tmp_path / "b", "i25_ins_oppo_boulevard"))
    both = suite_in(tmp_path / "both", parts=("a", "b"))
    assert OcclusionCertificateFile.load(both) == {first.scenario: first, second.scenario: second}
    suite_in(tmp_path / "b", "i25_ins_oppo_boulevard", "i01_ins_c_main_street_right")
    assert OcclusionCertificateFile.load(load_suite(str(both.folder))) == {first.scenario: first}
    told = CliRunner().invoke(main, ["list", "scenarios", "--suite", str(both.folder), "--occluded"])
    assert told.exit_code == 2
    assert "suite b: expected an up-to-date occlusion.json, found none" in told.output


def test_a_broken_file_gets_one_sentence(tmp_path: Path) -> None:
    (tmp_path / occlusion_certificate.CERTIFICATE_FILE).write_text('{"format": "other"}')
    with pytest.raises(InputError, match=r"occlusion.json: format: expected"):
        OcclusionCertificateFile.read(tmp_path)


def test_the_packaged_suite_is_certified_and_can_be_filtered() -> None:
    suite = load_suite("interdrive@0")
    certificates = OcclusionCertificateFile.load(suite)
    assert list(certificates) == [scenario.id for scenario in suite.scenarios]
    occluded = [name for name, one in certificates.items() if one.occluded]
    assert len(occluded) >= 15
    shown = CliRunner().invoke(main, ["list", "scenarios", "--suite", "interdrive@0", "--occluded"])
    assert shown.exit_code == 0
    assert [line.split()[0] for line in shown.output.splitlines() if line.startswith("i")] == occluded
    others = CliRunner().invoke(main, ["list", "scenarios", "--suite", "interdrive@0", "--not-occluded"])
    assert not set(occluded) & set(others.output.split())
