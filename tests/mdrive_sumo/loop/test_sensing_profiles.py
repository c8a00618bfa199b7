"""`sensing`: what agents get of their own state and of others under both profiles, and what stays exact."""

import math

import numpy as np
import pytest

import mdrive_sumo as md
from mdrive_sumo.contract import Control, Observation, Plan, Reply, SensorSpec
from mdrive_sumo.contract.detector_profiles import IDEAL, LIDAR_SINGLE, STANDARD
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Frame
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.sensing.roadside_units import find_detector
from mdrive_sumo.sensing.sensing_profile import SensingProfile

SCENARIO = "i40_hw_merge_loop_platoon"
SENSORS = (SensorSpec("objects", options={"profile": IDEAL}), *map(SensorSpec, ("gnss", "imu", "speedometer")))
COASTING = Reply(control=Control(0.3, 0.0, 0.0))


def drive(sensing: str, ticks: int, *sensors: SensorSpec) -> list[tuple[Frame, dict[str, Observation]]]:
    """True frames and observations of the first ticks of gentle driving."""
    with md.Simulation(SCENARIO, sensors=sensors or SENSORS, sensing=sensing) as simulation:
        observations = simulation.reset()
        found = [(simulation.frame, observations)]
        for _ in range(ticks):
            observations = simulation.step(dict.fromkeys(observations, COASTING))
            found.append((simulation.frame, observations))
    return found


def compute_own_errors(found: list[tuple[Frame, dict[str, Observation]]]) -> Float:
    """(N, 3) errors of position [m], yaw [rad] and speed [m/s] of all own states."""
    return np.array(
        [
            (math.hypot(seen.own.x - true.x, seen.own.y - true.y), seen.own.yaw - true.yaw, seen.own.speed - true.speed)
            for frame, observations in found
            for seen, true in ((observations[ego], frame.egos[ego]) for ego in observations)
        ]
    )


@pytest.mark.slow
def test_realistic_is_the_default_and_own_states_are_off_by_as_much_as_they_say() -> None:
    found = drive("realistic", 40)
    errors = compute_own_errors(found)
    own = found[-1][1]["0"].own
    assert (own.position_sigma, own.yaw_sigma) == (0.2, math.radians(0.2)) and own.speed_sigma > 0.0
    assert 0.02 < errors[:, 0].mean() < 5 * 0.2
    assert 0.0 < np.abs(errors[:, 1]).max() < 5 * own.yaw_sigma
    assert 0.0 < np.abs(errors[:, 2]).max() < 5 * 0.01 * 8.0
    with md.Simulation(SCENARIO) as simulation:
        assert simulation.briefings["0"].standard_detector == LIDAR_SINGLE
        assert simulation.reset()["0"].own.position_sigma == 0.2


def test_perfect_is_exact() -> None:
    found = drive("perfect", 10)
    assert not compute_own_errors(found).any()
    seen, truth = found[-1][1]["0"], found[-1][0].egos["0"]
    assert (seen.own.position_sigma, seen.own.yaw_sigma, seen.own.speed_sigma) == (0.0, 0.0, 0.0)
    assert seen.speedometer == truth.speed
    with md.Simulation(SCENARIO, sensing="perfect") as simulation:
        assert simulation.briefings["0"].standard_detector == IDEAL


def test_detections_fit_to_the_own_estimate_and_not_to_the_world() -> None:
    """Exact detections of the same objects under both profiles, seen from the car, and in the world."""
    estimated, exact = drive("realistic", 5)[-1], drive("perfect", 5)[-1]
    assert sum(len(seen.objects or ()) for seen in estimated[1].values()) > 0
    for ego, seen in estimated[1].items():
        other = exact[1][ego]
        assert seen.objects is not None and other.objects is not None
        assert len(seen.objects) == len(other.objects)
        mine, true = seen.own, estimated[0].egos[ego]
        offset = math.hypot(mine.x - true.x, mine.y - true.y)
        gap = np.hypot(seen.objects.x - mine.x, seen.objects.y - mine.y)
        assert gap == pytest.approx(np.hypot(other.objects.x - true.x, other.objects.y - true.y), abs=0.02)
        world = np.hypot(seen.objects.x - other.objects.x, seen.objects.y - other.objects.y)
        assert world == pytest.approx(np.full(len(world), offset), abs=0.05 + 0.01 * gap.max(initial=0.0))


def test_raw_receivers_do_not_tell_the_truth_either() -> None:
    from mdrive_sumo.sensing.navigation_sensors import to_compass, to_xy

    seen = drive("realistic", 5)[-1][1]["0"]
    assert seen.gnss is not None and seen.imu is not None
    assert to_xy(seen.gnss) == pytest.approx((seen.own.x, seen.own.y), abs=0.002)
    assert seen.imu.compass == pytest.approx(to_compass(seen.own.yaw))
    assert seen.speedometer == seen.own.speed


def test_privileged_agents_are_told_the_truth_and_drive_by_it() -> None:
    found = drive("realistic", 3, SensorSpec("privileged"))
    assert not compute_own_errors(found).any()
    privileged, frame = found[-1][1]["0"].privileged, found[-1][0]
    assert privileged is not None
    assert sorted((s.x, s.y) for s in privileged.states) == sorted((ego.x, ego.y) for ego in frame.egos.values())


def test_a_plan_is_followed_where_the_car_takes_itself_to_be() -> None:
    """A car that plans to stand where it takes itself to be stands, wherever that is."""
    with md.Simulation(SCENARIO, sensors=(), sensing="realistic") as simulation:
        observations = simulation.reset()
        start = {ego: simulation.frame.egos[ego] for ego in observations}
        for _ in range(30):
            plans = {ego: Plan(np.array([(seen.own.x, seen.own.y)] * 3), 0.2) for ego, seen in observations.items()}
            observations = simulation.step({ego: Reply(plan=plan) for ego, plan in plans.items()})
        for ego, state in start.items():
            now = simulation.frame.egos[ego]
            assert math.hypot(now.x - state.x, now.y - state.y) < 0.05 + state.speed


def test_the_same_seed_gives_the_same_estimates() -> None:
    first, second = drive("realistic", 5), drive("realistic", 5)
    assert [seen["0"].own for _, seen in first] == [seen["0"].own for _, seen in second]


def test_road_side_units_see_as_cars_do() -> None:
    unit = RoadsideUnit(id="rsu", x=0.0, y=0.0)
    realistic, perfect = SensingProfile.REALISTIC, SensingProfile.PERFECT
    assert [find_detector(unit, sensing) for sensing in (realistic, perfect)] == [LIDAR_SINGLE, IDEAL]
    other = unit.model_copy(update={"profile": "cobevt"})
    assert [find_detector(other, sensing) for sensing in (realistic, perfect)] == ["cobevt", IDEAL]


def test_the_standard_detector_is_that_of_the_profile() -> None:
    """After two ticks only, because the realistic one has a latency."""
    standard = SensorSpec("objects", options={"profile": STANDARD})
    first = {sensing: drive(sensing, 2, standard) for sensing in ("realistic", "perfect")}
    lengths = {name: [len(seen["0"].objects or ()) for _, seen in found] for name, found in first.items()}
    assert lengths["realistic"][:2] == [0, 0] and min(lengths["perfect"]) > 0


@pytest.mark.parametrize("value", ["exact", "", "REALISTIC"])
def test_an_unknown_profile_is_named(value: str) -> None:
    with pytest.raises(md.InputError, match=f"sensing: expected one of realistic, perfect, found '{value}'"):
        md.Simulation(SCENARIO, sensing=value)
