"""`study twins`: what hides a road user, twins by factor, numbers by hand, a study from the command line, bad input."""

import csv
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from testing.score_golden import BOX, ego, lane, roads, scenario
from testing.short_suite import shorten
from testing.study_samples import invoke, make_run, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Actors, EgoState, End, Frame, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, quantize_frame
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.scenario.variation import vary_scenario
from mdrive_sumo.scoring import EgoResult
from mdrive_sumo.study.occlusion_certificate import OccludedInterval, OcclusionCertificate, OcclusionCertificateFile
from mdrive_sumo.study.twin_scenarios import (
    HiddenConflicts,
    Occluders,
    TwinFactor,
    find_hidden_conflicts,
    list_hidden_pairs,
    make_twin,
)
from mdrive_sumo.study.twins import TwinRow, summarise_twins
from mdrive_sumo.study.twins_files import build_twins_table

PAIR = ("0", "walker")


def block(x: float, y: float) -> Building:
    """A house of 4 m by 4 m with this centre."""
    return Building(id=f"house {x} {y}", polygon=((x - 2, y - 2), (x + 2, y - 2), (x + 2, y + 2), (x - 2, y + 2)))


ROADS = replace(roads(lane("east", (-50, 0), (150, 0))), buildings=(block(30, 10), block(30, -20), block(90, 12)))
"""Houses between the CAV and the walker, on the other side of the road, and behind the place where they meet."""


def drive_past() -> EpisodeRecord:
    """CAV 0 drives from x = 0 to 100; a walker stands at (60, 20); CAV 1, a parked and a moving car stand between."""
    recorder = Recorder("s", {"seed": 1}, {"0": BOX, "1": BOX})
    for tick in range(101):
        x = float(tick)
        others = Actors(
            ("walker", "parked", "moving", "low"),
            np.array([Kind.PEDESTRIAN, Kind.VEHICLE, Kind.VEHICLE, Kind.STATIC], dtype=np.uint8),
            np.array([60.0, 45.0, 40.0 + 0.1 * tick, 48.0]),
            np.array([20.0, 12.0, 8.0, 14.0]),
            np.zeros(4),
            np.array([0.0, 0.0, 2.0, 0.0]),
            np.array([0.5, 4.6, 4.6, 0.4]),
            np.array([0.5, 1.8, 1.8, 0.4]),
        )
        egos = {"0": EgoState(x, 0.0, 0.0, 20.0), "1": EgoState(50.0, 10.0, 0.0, 0.0)}
        recorder.add(quantize_frame(Frame(tick, egos, others, {}, ())), {}, {}, {})
    return recorder.finish([Ending("0", 100, End.ARRIVED), Ending("1", 100, End.ARRIVED)])


def test_what_hides_a_road_user_stands_and_is_no_cav() -> None:
    found = find_hidden_conflicts({PAIR}, drive_past(), ROADS)
    assert found == HiddenConflicts(frozenset({PAIR}), Occluders(frozenset({0}), frozenset({"parked"})))


def test_a_road_user_that_never_appears_is_hidden_by_nothing() -> None:
    assert find_hidden_conflicts({("0", "nobody")}, drive_past(), ROADS).occluders == Occluders()


def test_certificates_of_both_kinds_name_pairs() -> None:
    for name in ("hard@0", "v2xpnp@0"):
        suite = load_suite(name)
        pairs = list_hidden_pairs(suite)
        assert list(pairs) == [scenario.id for scenario in suite.scenarios]
        named = next(found for found in pairs.values() if found)
        assert all(isinstance(ego, str) and isinstance(user, str) for ego, user in named)


def car(name: str) -> BackgroundVehicle:
    return BackgroundVehicle(id=name, depart_s=0.0, edges=("east",))


FULL = scenario(
    ego("0"),
    ego("1", y=20.0),
    background=Background(vehicles=(car("parked"), car("hidden"), car("a"), car("b"))),
    weather="rain",
    rsus=(RoadsideUnit(id="rsu", x=0.0, y=0.0),),
)
CONFLICTS = HiddenConflicts(frozenset({("0", "hidden")}), Occluders(frozenset({0, 2}), frozenset({"parked"})))


def list_vehicles(about: Scenario) -> list[str]:
    return [vehicle.id for vehicle in vary_scenario(about, ROADS, 0).background.vehicles]


def test_exactly_one_factor_changes() -> None:
    twins = {factor: make_twin(FULL, ROADS, factor, CONFLICTS) for factor in TwinFactor}
    free = twins[TwinFactor.OCCLUDER]
    assert free.roads.buildings == ROADS.buildings[1:2]
    assert list_vehicles(free.scenario) == ["hidden", "a", "b"]
    assert free.changes == ("2 buildings", "parked")
    empty = twins[TwinFactor.BACKGROUND]
    assert list_vehicles(empty.scenario) == ["parked", "hidden"], "occluders and hidden road users are other factors"
    assert twins[TwinFactor.WEATHER].scenario == FULL.model_copy(update={"weather": "default"})
    for factor in (TwinFactor.CONNECTION, TwinFactor.STRANGER):
        assert (twins[factor].scenario, twins[factor].roads) == (FULL, ROADS)
    for twin in (free, empty):
        assert twin.scenario.model_copy(update={"absent": ()}) == FULL


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_seed_draws_the_same_world_for_twins(seed: int) -> None:
    """Without the car in front, which a twin lacks, a CAV that is drawn anew could start elsewhere."""
    ahead = Actor(id="ahead", kind="vehicle", length=4.6, width=1.8, start=Pose(x=5.2, y=0.0, yaw=0.0))
    about = FULL.model_copy(update={"actors": (ahead,)})
    original = vary_scenario(about, ROADS, seed)
    twin = vary_scenario(about.model_copy(update={"absent": ("ahead", "a")}), ROADS, seed)
    assert (twin.egos, twin.actors, twin.absent) == (original.egos, (), ())
    assert twin.background.vehicles == tuple(one for one in original.background.vehicles if one.id != "a")
    assert vary_scenario(FULL, ROADS, seed).egos != original.egos, "the test can fail"


def test_absent_road_users_are_known() -> None:
    with pytest.raises(ValueError, match="absent: expected ids of actors or background vehicles, found 'nobody'"):
        Scenario.model_validate(FULL.model_dump() | {"absent": ["nobody"]})


@pytest.mark.parametrize(
    ("factor", "about", "conflicts", "sentence"),
    [
        ("occluder", FULL, HiddenConflicts(), "expected a certified or occluded conflict, found none"),
        (
            "occluder",
            FULL,
            HiddenConflicts(CONFLICTS.pairs),
            "expected a building, prop or standing vehicle that",
        ),
        ("connection", scenario(ego("0")), CONFLICTS, "expected two stations or more, found one CAV and no road-side"),
        ("background", scenario(ego("0")), CONFLICTS, "expected vehicles in the background that neither hide"),
        ("weather", scenario(ego("0")), CONFLICTS, "expected rain or night, found default"),
        ("weather", scenario(ego("0"), weather="cloudy"), CONFLICTS, "expected rain or night, found cloudy"),
        ("stranger", scenario(ego("0")), CONFLICTS, "expected two CAVs or more, found one"),
    ],
)
def test_a_twin_that_cannot_be_made_names_its_factor(
    factor: str, about: Scenario, conflicts: HiddenConflicts, sentence: str
) -> None:
    with pytest.raises(InputError, match=f"s: twin {factor}: {sentence}"):
        make_twin(about, ROADS, TwinFactor(factor), conflicts)


def cav(name: str, ds: float, *, is_other: bool = False) -> EgoResult:
    values = {"id": name, "outcome": "arrived", "reason": "", "ds": ds, "rc": ds, "ip": 1.0, "infractions": []}
    return EgoResult.model_validate(values | {"is_other": is_other})


def row(factor: TwinFactor | None, *episodes: Sequence[EgoResult], seeds: int = 1) -> TwinRow:
    """An agent in scenarios s0, s1 ..., each with these CAVs with every seed; without CAVs it is void."""
    runs = [
        make_run(
            *(
                make_scenario(f"s{i}", sum(one.ds for one in egos) / len(egos), seed=seed, egos=tuple(egos))
                if egos
                else make_scenario(f"s{i}", 0.0, seed=seed, status="void", reason="SUMO ended")
                for i, egos in enumerate(episodes)
            )
        )
        for seed in range(seeds)
    ]
    twins = tuple(make_twin(FULL, ROADS, factor, CONFLICTS) for _ in episodes) if factor else ()
    return TwinRow("x", factor, tuple(runs), twins)


def test_the_change_is_paired_and_void_scenarios_are_left_out() -> None:
    pair = cav("0", 80.0), cav("1", 40.0)
    better = cav("0", 100.0), cav("1", 60.0)
    rows = [row(None, pair, pair, pair, seeds=2), row(TwinFactor.OCCLUDER, better, (), pair, seeds=2)]
    summary = summarise_twins(rows)
    (line,) = summary.lines
    assert (line.original["ds"].mean, line.twin["ds"].mean, line.change["ds"].mean) == (60.0, 70.0, 10.0)
    assert (line.scenarios, summary.void, len(line.pairs)) == (2, 1, 4)
    assert [cell.value for cell in build_twins_table(summary).rows[0].cells][:5] == ["x", "occluder", 2, 60.0, 70.0]


def test_with_a_stranger_the_same_cavs_are_compared() -> None:
    """CAV 1 is the stranger's: its 0 does not count, nor does its 40 in the original."""
    rows = [
        row(None, (cav("0", 80.0), cav("1", 40.0))),
        row(TwinFactor.STRANGER, (cav("0", 70.0, is_other=True), cav("1", 0.0))),
    ]
    (line,) = summarise_twins(rows).lines
    assert (line.original["ds"].mean, line.change["ds"].mean) == (80.0, -10.0)


def test_twins_that_are_all_void_have_no_numbers() -> None:
    with pytest.raises(InputError, match="expected twins that are not void, found none"):
        summarise_twins([row(None, (cav("0", 1.0),)), row(TwinFactor.WEATHER, ())])


@pytest.fixture(scope="module")
def folder(in_process: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A suite of two short scenarios in rain, the first with houses between its CAVs and a certificate that says so."""
    folder = tmp_path_factory.mktemp("twins")
    second, first = (shorten(one, 15) for one in load_suite("interdrive@0").select("i05_ins_c_skew*,i07_ins_ss_town"))
    first = first.model_copy(update={"weather": "rain"})
    save_suite(Suite(SuiteFile(name="short", title="A short suite"), folder / "suite", (first, second)))
    hidden = OccludedInterval(drive="omniscient", ego="0", actor="1", start_s=0.0, end_s=2.0, conflict_s=3.0, by=("1",))
    certificate = OcclusionCertificate(scenario=first.id, hidden=(hidden,))
    OcclusionCertificateFile.write(load_suite(str(folder / "suite")), {first.id: certificate})
    return folder


def study(folder: Path, *words: str) -> Result:
    common = ("--suite", folder / "suite", "--seed", 0, "--seeds", 1, "--workers", 1, "--out", folder / "out")
    return invoke("study", "twins", *map(str, common), *words)


@pytest.mark.slow
def test_a_study_of_twins_from_the_command_line(folder: Path, in_process: None) -> None:
    ended = study(folder, "--agent", "single")
    assert ended.exit_code == 0, ended.output
    page = json.loads((folder / "out" / "twins.json").read_text())
    counts = {line["factor"]: line["scenarios"] for line in page["lines"]}
    assert counts == {"occluder": 1, "connection": 2, "weather": 1, "stranger": 2}
    missing = {(gap["scenario"], gap["factor"]) for gap in page["not_made"]}
    assert ("i07_ins_ss_town", "background") in missing
    assert ("i05_ins_c_skewed_left", "occluder") in missing
    assert "twin background: expected vehicles in the background" in (folder / "out" / "twins.md").read_text()
    free = load_suite(str(folder / "out" / "suites" / "occluder"))
    (network,) = (free.folder / "networks").iterdir()
    assert network.name == free.scenarios[0].network == "town_crossing.i07_ins_ss_town"
    assert len(json.loads((network / "network.json").read_text())["buildings"]) < 30
    with (folder / "out" / "twins-episodes.csv").open() as lines:
        assert len(list(csv.DictReader(lines))) == 6
    assert (folder / "out" / "twins.svg").read_text().startswith("<?xml")
    again = study(folder, "--agent", "single")
    assert (again.exit_code, json.loads((folder / "out" / "twins.json").read_text())) == (0, page)
    assert "DS" not in again.stderr, "nothing is driven again"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--factor", "nothing"), "expected one of occluder, connection, background, weather, stranger, found 'noth"),
        (("--stranger", "single"), "--stranger: expected an agent that is not among --agent, found 'single'"),
        (("--agent", "idm", "--agent", "idm"), "--agent: expected different agents"),
        (("--factor", "background"), "study twins: expected a twin that can be made, found none"),
        (("--stranger", "nobody"), "agent 'nobody': expected"),
    ],
)
def test_bad_input_is_one_sentence(folder: Path, words: tuple[str, ...], sentence: str) -> None:
    ended = study(folder, *words, "--fresh")
    assert (ended.exit_code, "Traceback" in ended.output) == (2, False)
    assert sentence in ended.output
