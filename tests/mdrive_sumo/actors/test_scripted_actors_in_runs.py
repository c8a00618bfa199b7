"""Scripted actors in complete runs: SUMO, scores, recordings, `verify` and `rescore`."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.actors_world import actor
from testing.local_executor import run_in_workers
from testing.suite_fakes import NET, NETWORK, make_suite

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Kind
from mdrive_sumo.episode import load_episode
from mdrive_sumo.roads import load_road_map
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, DistanceTrigger, LaneMotion, PathMotion
from mdrive_sumo.scenario.suite import Suite, SuiteFile, save_suite
from mdrive_sumo.scoring import Results, load_results

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]

assert NET
assert NETWORK


def prop(name: str, x: float, y: float = 0.0) -> Actor:
    it = PROPS[name]
    return Actor(
        id="it", kind=it.kind, model=name, length=it.length, width=it.width, start=Pose(x=x, y=y, yaw=0.0)
    )  # fmt: skip


THINGS = {
    "pedestrian": (actor("it", "pedestrian", at=(30, 0)), 0.50),
    "cyclist": (actor("it", "cyclist", at=(30, 0)), 0.60),
    "parked-car": (prop("parked-car", 30), 0.60),
    "cone": (prop("cone", 30), 0.65),
}


def scenario(name: str, *actors: Actor, metres: int = 70) -> Scenario:
    route = tuple((5.0 + i, 0.0, 0.0) for i in range(metres + 1))
    ego = Ego(id="0", start=Pose(x=5, y=0, yaw=0), lanes=("a_0",), route=route)
    return Scenario(id=name, bucket="Tiny", category="actors", network="flat", egos=(ego,), actors=actors)


def suite(folder: Path, *scenarios: Scenario) -> Path:
    made = make_suite(folder, "unused")
    save_suite(Suite(SuiteFile(name="things", title="Things"), folder, scenarios))
    (folder / made.scenarios[0].id / "scenario.json").unlink()
    return folder


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def evaluated(folder: Path, out: Path, *more: object, agent: str = "constant-speed") -> Results:
    done = call("eval", "--suite", folder, "--agent", agent, "--out", out, *more)
    assert done.exit_code == 0, done.output
    return load_results(out / "results.json")


@pytest.fixture(scope="module")
def crashes(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Results]:
    folder = tmp_path_factory.mktemp("actors")
    things = suite(folder / "suite", *(scenario(name, thing, metres=45) for name, (thing, _) in THINGS.items()))
    return things, folder / "run", evaluated(things, folder / "run", "--workers", 1)


@pytest.mark.parametrize("name", THINGS)
def test_hitting_each_class_costs_what_the_protocol_says(crashes: tuple[Path, Path, Results], name: str) -> None:
    result = next(result for result in crashes[2].scenarios if result.id == name)
    infractions = [i for i in result.egos[0].infractions if i.factor < 1.0]
    assert [(i.factor, i.other) for i in infractions] == [(THINGS[name][1], "it")]
    assert result.egos[0].ip == THINGS[name][1]


def test_the_recording_knows_them(crashes: tuple[Path, Path, Results]) -> None:
    episode = load_episode(crashes[1] / "episodes" / "pedestrian.npz")
    assert episode.ids == ("0", "it")
    assert episode.about["actors"] == "default"
    assert {contact.kind for _, contact in episode.contacts} == {Kind.PEDESTRIAN}


@pytest.mark.full
def test_two_workers_make_the_same_and_verify_and_rescore_agree(
    crashes: tuple[Path, Path, Results], monkeypatch: pytest.MonkeyPatch
) -> None:
    things, run, once = crashes
    run_in_workers(monkeypatch)
    again = evaluated(things, run.with_name("two"), "--workers", 2)
    assert [result.digest for result in again.scenarios] == [result.digest for result in once.scenarios]
    done = call("verify", run, "--workers", 1)
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[-1] == "4 of 4 scenarios are identical"
    done = call("rescore", run)
    assert done.exit_code == 0, done.output


@pytest.mark.full
def test_the_mode_stands_in_results_and_fingerprint_and_verify_honours_it(tmp_path: Path) -> None:
    npc = actor("it", "vehicle", points=[(60, -30), (60, 60)], speed=9, start_speed=9).model_copy(
        update={"trigger": DistanceTrigger(vehicle="0", distance_m=40.0)}
    )
    walker = actor("walker", "pedestrian", points=[(75, 5), (75, 60)], speed=1.5)
    folder = suite(tmp_path / "suite", scenario("s", npc, walker))
    default = evaluated(folder, tmp_path / "default", agent="stationary")
    original = evaluated(folder, tmp_path / "original", "--actors", "original", agent="constant-speed")
    assert (default.run.conditions["actors"], original.run.conditions["actors"]) == ("default", "original")
    assert "actors: original" in (tmp_path / "original" / "report.md").read_text()
    first = json.loads((tmp_path / "original" / "journal.jsonl").read_text().splitlines()[0])
    assert "original" in json.dumps(first)
    assert load_episode(tmp_path / "original" / "episodes" / "s.npz").about["actors"] == "original"
    done = call("verify", tmp_path / "original", "--workers", 1)
    assert done.output.splitlines()[-1] == "1 of 1 scenarios are identical", done.output


def test_a_reacting_vehicle_stops_for_the_cav_and_an_original_one_does_not(tmp_path: Path) -> None:
    npc = actor("it", "vehicle", points=[(5, -40), (5, 40)], speed=9, start_speed=9)
    folder = suite(tmp_path / "suite", scenario("s", npc, metres=2))  # time for 9 s
    default = evaluated(folder, tmp_path / "default", agent="stationary")
    original = evaluated(folder, tmp_path / "original", "--actors", "original", agent="stationary")
    assert default.scenarios[0].egos[0].ip == 1.0
    hit = original.scenarios[0].egos[0].infractions[0]
    assert (hit.kind, hit.factor, hit.other) == ("collision-vehicle", 0.60, "it")


WRONG = {
    "expected lanes of network flat, found 'b_0'": actor("it", "vehicle", at=(30, 0)).model_copy(
        update={"motion": LaneMotion(lanes=("b_0",), speed=5)}
    ),
    "which is not connected": actor("it", "vehicle", at=(30, 0)).model_copy(
        update={"motion": LaneMotion(lanes=("a_0", "a_0"), speed=5)}
    ),
    "within 500 m of the map's lanes": actor("it", "vehicle", points=[(30, 0), (9000, 0)], speed=5),
    "within 4 m of where its motion begins, found 20.0 m": actor("it", "vehicle", at=(30, 0)).model_copy(
        update={"motion": PathMotion(points=((50, 0), (60, 0)), speed=5)}
    ),
    "a path that leads somewhere": actor("it", "vehicle", at=(30, 0)).model_copy(
        update={"motion": PathMotion(points=((30, 0), (30, 0.01)), speed=5)}
    ),
    "found CAV 0 there": prop("parked-car", 8.0, 1.0),
    "start: expected room, found CAV 0": actor("it", "vehicle", at=(8, 4.5)).model_copy(
        update={"motion": PathMotion(points=((8, 1), (60, 1)), speed=5)}
    ),
}


@pytest.mark.parametrize("sentence", WRONG)
def test_an_actor_that_does_not_fit_is_refused_before_the_first_tick(sentence: str, tmp_path: Path) -> None:
    folder = suite(tmp_path / "suite", scenario("s", WRONG[sentence]))
    with pytest.raises(InputError, match=sentence.replace("(", "\\(")):
        check_scenario(scenario("s", WRONG[sentence]), load_road_map(folder / "networks" / "flat"))
    done = call("eval", "--suite", folder, "--out", tmp_path / "run")
    assert done.exit_code == 2
    assert "scenario s: actor it: " in done.output
    assert sentence in " ".join(done.output.split())
    assert len(done.output.strip().splitlines()) <= 3


def test_every_prop_has_a_size_and_a_class_with_a_factor() -> None:
    for it in PROPS.values():
        assert it.length > 0
        assert it.width > 0
        assert it.kind in ("static", "vehicle")
