"""Weather in whole episodes, by the command line: how far is seen, and with `--friction weather` slippery roads."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from testing.suite_fakes import make_suite

from mdrive_sumo.cli import main
from mdrive_sumo.contract import STANDSTILL, Control
from mdrive_sumo.core.state import DT, Actors
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.suite import Suite, SuiteFile, save_suite
from mdrive_sumo.scenario.weather import WEATHERS, FrictionMode, WeatherName
from mdrive_sumo.scoring import Results, load_results
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.vehicle.dynamics import GRAVITY, MKZ_2017, VehicleState, step

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]

SPEED = 12.0
WET = WEATHERS["rain"].grip
LOOKOUT = """
from mdrive_sumo.contract import Control, Note, Reply, SensorSpec

class Lookout:
    label = "single"
    def __init__(self, config): pass
    def sensors(self): return (SensorSpec("objects", range_m=60.0),)
    def start(self, briefing): pass
    def act(self, seen):
        new = seen.objects.ids if seen.tick == 0 else ()
        return Reply(control=Control(1.0, 0.0, 0.0), notes=tuple(Note("sees", name) for name in new))
"""


def scenario(weather: WeatherName, *actors: Actor, name: str = "s", speed: float = SPEED) -> Scenario:
    route = tuple((5.0 + i, 0.0, 0.0) for i in range(71))
    ego = Ego(id="0", start=Pose(x=5, y=0, yaw=0), lanes=("a_0",), route=route, start_speed=speed)
    return Scenario(
        id=name, bucket="Tiny", category="weather", network="flat", egos=(ego,), actors=actors, weather=weather
    )


def suite(folder: Path, *scenarios: Scenario) -> Path:
    made = make_suite(folder, "unused")
    (folder / made.scenarios[0].id / "scenario.json").unlink()
    save_suite(Suite(SuiteFile(name="weather", title="Weather"), folder, scenarios))
    return folder


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def evaluated(folder: Path, out: Path, *more: object, agent: str = "stationary") -> Results:
    done = call("eval", "--suite", folder, "--agent", agent, "--workers", 1, "--out", out, *more)
    assert done.exit_code == 0, done.output
    return load_results(out / "results.json")


def episode_of(out: Path, name: str = "s") -> EpisodeRecord:
    return load_episode(out / "episodes" / f"{name}.npz")


@pytest.fixture(scope="module")
def rain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a suite in the rain, and a run of it on a dry and on a wet road."""
    folder = tmp_path_factory.mktemp("rain")
    made = suite(folder / "suite", scenario("rain"))
    evaluated(made, folder / "dry")
    evaluated(made, folder / "wet", "--friction", "weather")
    return folder


def stopping_m(grip: float) -> float:
    """From `SPEED`: v^2 / 2a, and what the lag of the pedal costs on the way to the greatest force there is."""
    brake, rolling = grip * MKZ_2017.max_deceleration, MKZ_2017.rolling_resistance * GRAVITY
    return SPEED**2 / (2 * (brake + rolling)) + SPEED * MKZ_2017.brake_lag * brake / (brake + rolling)


@pytest.mark.parametrize(("run", "grip"), [("dry", 1.0), ("wet", WET)])
def test_a_full_brake_takes_the_way_that_the_friction_allows(rain: Path, run: str, grip: float) -> None:
    episode = episode_of(rain / run)
    assert float(episode.x[-1, 0] - episode.x[0, 0]) == pytest.approx(stopping_m(grip), rel=0.02)


@pytest.mark.parametrize(("run", "friction"), [("dry", "dry"), ("wet", "weather")])
def test_the_choice_stands_everywhere_and_verify_and_rescore_honour_it(rain: Path, run: str, friction: str) -> None:
    folder = rain / run
    assert load_results(folder / "results.json").run.conditions["friction"] == friction
    assert f"friction: {friction}" in (folder / "report.md").read_text()
    header = json.loads((folder / "journal.jsonl").read_text().splitlines()[0])
    assert header["fingerprint"]["friction"] == friction
    assert episode_of(folder).about["friction"] == friction
    done = call("verify", folder, "--workers", 1)
    assert done.output.splitlines()[-1] == "1 of 1 scenarios are identical", done.output
    done = call("rescore", folder)
    assert done.exit_code == 0, done.output


def test_a_run_does_not_go_on_with_another_friction(rain: Path) -> None:
    done = call(
        "eval", "--suite", rain / "suite", "--agent", "stationary", "--out", rain / "dry", "--friction", "weather"
    )
    assert done.exit_code == 2
    assert "friction dry (now weather)" in " ".join(done.output.split())


def test_without_the_option_and_without_rain_nothing_changes(rain: Path, tmp_path: Path) -> None:
    made = suite(tmp_path / "suite", scenario("default"))
    fair = evaluated(made, tmp_path / "run", "--friction", "weather")
    assert fair.scenarios[0].digest == episode_of(rain / "dry").digest
    assert fair.scenarios[0].digest != episode_of(rain / "wet").digest


def test_an_unknown_friction_is_refused() -> None:
    done = call("eval", "--friction", "ice")
    assert done.exit_code == 2
    assert "expected one of dry, weather, found 'ice'" in done.output


def test_only_rain_makes_roads_slippery_and_only_if_asked() -> None:
    assert {name: FrictionMode.WEATHER.grip_in(name) for name in WEATHERS} == {
        "default": 1.0, "cloudy": 1.0, "night": 1.0, "rain": WET
    }  # fmt: skip
    assert {FrictionMode.DRY.grip_in(name) for name in WEATHERS} == {1.0}
    assert 0.5 / 0.8 <= WET <= 0.7 / 0.8  # the range of the table in docs/sensors.md


def track(control: Control, speed: float, seconds: float, grip: float) -> list[VehicleState]:
    bodies = [VehicleState(0, 0, 0, vx=speed)]
    car = replace(MKZ_2017, grip=grip)
    for _ in range(round(seconds / DT)):
        bodies.append(step(bodies[-1], control, car))
    return bodies


@pytest.mark.parametrize("grip", [1.0, 0.7, 0.3])
def test_lateral_and_drive_forces_shrink_with_the_grip(grip: float) -> None:
    turning = track(Control(0.0, 0.0, 0.6), 15.0, 1.5, grip)
    lateral = max(body.vx * body.yaw_rate for body in turning[10:])
    assert lateral == pytest.approx(grip * MKZ_2017.friction * GRAVITY, rel=0.15)
    pulled = track(Control(1.0, 0.0, 0.0), 5.0, 2.0, grip)[-1].acceleration
    assert pulled == pytest.approx(grip * MKZ_2017.max_acceleration - 0.012 * GRAVITY, rel=0.03)


def test_a_gentle_brake_does_the_same_on_a_wet_road() -> None:
    """Pedals are what they were; only the greatest forces are smaller."""
    gentle = Control(0.0, 0.4, 0.0)
    assert track(gentle, 10.0, 1.0, WET) == track(gentle, 10.0, 1.0, 1.0)
    assert track(STANDSTILL, 10.0, 1.0, WET) != track(STANDSTILL, 10.0, 1.0, 1.0)


def speeds(grip: float) -> list[float]:
    """Of a car of SUMO's on an empty motorway [m/s]."""
    roads = load_road_map(find_network_folder("motorway"))
    ego = Ego(id="e", start=Pose(x=0, y=0, yaw=0), lanes=("weave_0",), route=((0, 0, 0), (1, 0, 0)))
    car = BackgroundVehicle(id="bg", depart_s=0, edges=("weave", "after"), depart_lane=1, depart_pos_m=10.0)
    made = Scenario(
        id="s", bucket="T", category="t", network="motorway", egos=(ego,), background=Background(vehicles=(car,))
    )
    with SumoWorld(made, roads, {}, 1, grip) as world:
        frames = [world.start({}, Actors.empty()), *(world.advance({}, Actors.empty(), ()) for _ in range(300))]
    return [float(frame.actors.speed[0]) for frame in frames if len(frame.actors)]


def test_sumo_drives_slower_where_it_is_slippery_and_the_same_twice() -> None:
    dry, wet = speeds(1.0), speeds(WET)
    factor = -0.3491 * WET**2 + 0.8922 * WET + 0.4493
    assert max(wet) / max(dry) == pytest.approx(factor, rel=0.005)
    assert wet == speeds(WET)


@pytest.mark.full
def test_rain_and_night_shorten_sight_by_the_command_line(tmp_path: Path) -> None:
    """Cones 41, 45 and 55 m away, beside each other; 60 m of range are 48 m in rain and 42 m at night."""
    (tmp_path / "lookout.py").write_text(LOOKOUT)
    prop = PROPS["cone"]
    cones = tuple(
        Actor(
            id=f"at{way}", kind=prop.kind, model="cone", length=prop.length, width=prop.width,
            start=Pose(x=5.0 + math.sqrt(way**2 - y**2) + prop.length / 2, y=y, yaw=0.0),
        )
        for way, y in ((41, 6.0), (45, 8.0), (55, -8.0))
    )  # fmt: skip
    weathers: tuple[WeatherName, ...] = ("default", "cloudy", "rain", "night")
    made = suite(tmp_path / "suite", *(scenario(name, *cones, name=name, speed=0.0) for name in weathers))
    done = evaluated(made, tmp_path / "run", agent=f"{tmp_path / 'lookout.py'}:Lookout")
    seen = {result.id: result.notes["sees"] for result in done.scenarios}
    assert seen == {"default": 3, "cloudy": 3, "rain": 2, "night": 1}
    assert np.all(episode_of(tmp_path / "run", "rain").valid)
