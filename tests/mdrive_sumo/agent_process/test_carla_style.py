"""Agents of the CARLA leaderboard: CARLA's frames, units and signs against ours."""

import math
import sys
from collections.abc import Iterator
from types import MappingProxyType

import numpy as np
import pytest

from mdrive_sumo.agent_process import carla_adapter, carla_stubs
from mdrive_sumo.agent_process.carla_stubs import (
    Location,
    RoadOption,
    Rotation,
    Track,
    Transform,
    Vector3D,
    VehicleControl,
)
from mdrive_sumo.contract import Briefing, Control, Imu, Observation, OwnState, PointCloud, VehicleFacts
from mdrive_sumo.core.state import DT
from mdrive_sumo.sensing.camera.camera_sensor import read_camera_model
from mdrive_sumo.sensing.navigation_sensors import to_compass, to_gnss, to_xy

FACTS = VehicleFacts(*(1.0,) * 9)


def briefing(xy: np.ndarray, yaw: np.ndarray) -> Briefing:
    ones = np.ones(len(xy))
    return Briefing("a", 0, DT, 60.0, FACTS, xy, yaw, np.arange(len(xy), dtype=float), ones, ones)


def arc(turn: float, straight: int = 20) -> Briefing:
    """Straight, a bend of radius 10 m by that angle, straight again; from heading east."""
    steps = max(int(abs(turn) * 10), 1)
    yaw = np.concatenate((np.zeros(straight), np.linspace(0, turn, steps + 1), np.full(straight, turn)))
    middle = (yaw[1:] + yaw[:-1]) / 2
    xy = np.concatenate((np.zeros((1, 2)), np.cumsum(np.column_stack((np.cos(middle), np.sin(middle))), axis=0)))
    return briefing(xy, yaw)


def seen(yaw: float = 0.0, **sensors: object) -> Observation:
    return Observation(40, OwnState(10.0, 20.0, yaw, 5.0, 1.0, 0.2, 0.0), **sensors)


def style(
    *declared: dict[str, object], cavs: tuple[str, ...] = ("a",), **more: object
) -> carla_adapter.CarlaAgentAdapter:
    """A CarlaStyle around an agent made here."""

    class Agent:
        agent_name = more.get("agent_name", "mine")

        def sensors(self) -> list[dict[str, object]]:
            return list(declared)

        def run_step(self, data: dict[str, object], timestamp: float) -> object:
            self.seen = data, timestamp
            return more.get("controls", [VehicleControl()] * len(cavs))

    made = carla_adapter.CarlaAgentAdapter.__new__(carla_adapter.CarlaAgentAdapter)
    made._agent, made._cavs, made._sensors, made._is_single = Agent(), cavs, (), False
    return made


def read(observation: Observation, **declared: object) -> object:
    one = style(declared)
    one.sensors()
    one.act({"a": observation})
    data, timestamp = one._agent.seen
    assert timestamp == pytest.approx(2.0)
    [(name, (frame, value))] = data.items()
    assert (name, frame) == ("x_0", 40)
    return value


def test_the_world_is_mirrored_north_is_minus_y_and_yaw_is_clockwise() -> None:
    there = briefing(np.array([(3.0, 4.0), (3.0, 5.0)]), np.array([math.pi / 2] * 2))
    first = carla_adapter.make_transforms(there)[0]
    assert (first.location, first.rotation.yaw) == (Location(3.0, -4.0, 0.0), pytest.approx(-90.0))
    ahead = first.get_forward_vector()
    assert (ahead.x, ahead.y) == (pytest.approx(0.0, abs=1e-12), pytest.approx(-1.0))


@pytest.mark.parametrize(
    ("control", "expected"),
    [
        (VehicleControl(throttle=0.5, steer=0.3), Control(0.5, 0.0, -0.3)),
        (VehicleControl(steer=-0.25, brake=0.7), Control(0.0, 0.7, 0.25)),
        (VehicleControl(throttle=1.5, steer=-7.0, brake=-1.0), Control(1.0, 0.0, 1.0)),
        (VehicleControl(throttle=0.5, reverse=True), Control(0.0, 0.0, 0.0)),
        (VehicleControl(throttle=0.5, hand_brake=True), Control(0.5, 1.0, 0.0)),
    ],
    ids=("right", "left", "cut", "reverse", "hand-brake"),
)
def test_steering_is_positive_to_the_right_there_and_to_the_left_here(
    control: VehicleControl, expected: Control
) -> None:
    reply = style(controls=[control]).act({"a": seen()})["a"]
    assert reply is not None and reply.control == expected


def test_controls_go_by_the_number_of_the_cav() -> None:
    one = style(cavs=("b", "a", "c"), controls=[VehicleControl(throttle=t) for t in (0.1, 0.2, 0.3)])
    replies = one.act({"c": seen(), "b": seen()})
    assert {name: reply.control.throttle for name, reply in replies.items() if reply and reply.control} == {
        "b": 0.1,
        "c": 0.3,
    }


def test_a_single_control_is_enough_for_a_single_cav() -> None:
    reply = style(controls=VehicleControl(brake=1.0)).act({"a": seen()})["a"]
    assert reply is not None and reply.control == Control(0.0, 1.0, 0.0)


def test_lidar_points_have_y_to_the_right() -> None:
    points = np.array([(5.0, 2.0, 1.0, 0.5)], dtype=np.float32)
    ours = MappingProxyType({"x": PointCloud(points, np.zeros(0, dtype=np.int32), ())})
    found = read(seen(lidar=ours), type="sensor.lidar.ray_cast", id="x")
    assert isinstance(found, np.ndarray) and found.dtype == np.float32
    assert found.tolist() == [[5.0, -2.0, 1.0, 0.5]]
    assert points[0, 1] == 2.0


def test_a_slow_lidar_is_missing_between_its_turns() -> None:
    one = style({"type": "sensor.lidar.ray_cast", "id": "x"}, agent_name="lmdrive")
    assert one.sensors()[0].options["profile"] == "lmdrive"
    one.act({"a": seen()})
    assert one._agent.seen[0] == {}


def test_the_pose_of_a_lidar_is_mirrored_and_its_rays_are_not_asked_for() -> None:
    row = {
        "type": "sensor.lidar.ray_cast",
        "id": "top",
        "x": 1.3,
        "y": 0.4,
        "z": 2.5,
        "roll": 1.0,
        "pitch": 2.0,
        "yaw": -90.0,
    }
    [spec] = style({**row, "channels": 32, "range": 20}).sensors()
    assert (spec.kind, spec.id) == ("lidar", "top")
    expected = {
        "x": 1.3,
        "y": -0.4,
        "z": 2.5,
        "roll_deg": 1.0,
        "pitch_deg": -2.0,
        "yaw_deg": 90.0,
        "profile": "default",
    }
    assert dict(spec.options) == expected


def test_a_car_that_turns_left_and_speeds_up() -> None:
    ours = Imu((1.0, 2.0, 9.81), (0.1, 0.2, 0.3), to_compass(0.5))
    found = read(seen(imu=ours), type="sensor.other.imu", id="x")
    assert isinstance(found, np.ndarray)
    assert found.tolist() == [1.0, -2.0, 9.81, -0.1, 0.2, -0.3, to_compass(0.5)]


@pytest.mark.parametrize("yaw", [0.0, 1.0, math.pi / 2, -2.5])
def test_a_receiver_tells_where_it_was_put(yaw: float) -> None:
    found = read(seen(yaw, gnss=to_gnss(10.0, 20.0)), type="sensor.other.gnss", id="x", x=1.5, y=0.5, z=2.0)
    assert isinstance(found, np.ndarray)
    there = to_xy(type(to_gnss(0, 0))(*found.tolist()))
    ahead, left = (math.cos(yaw), math.sin(yaw)), (-math.sin(yaw), math.cos(yaw))
    assert there == pytest.approx([10 + 1.5 * ahead[0] - 0.5 * left[0], 20 + 1.5 * ahead[1] - 0.5 * left[1]], abs=1e-6)
    assert found[2] == 2.0


def test_a_speedometer() -> None:
    assert read(seen(speedometer=5.0), type="sensor.speedometer", id="x") == {"speed": 5.0}


def test_sensors_that_do_not_exist_keep_their_name_and_several_receivers_are_one() -> None:
    rows = ("sensor.other.gnss", "sensor.other.gnss", "sensor.camera.dvs", "sensor.opendrive_map")
    specs = style(*({"type": kind, "id": f"s{i}"} for i, kind in enumerate(rows))).sensors()
    assert [spec.kind for spec in specs] == ["gnss", "sensor.camera.dvs", "sensor.opendrive_map"]


def test_a_camera_is_mirrored_and_has_the_declared_image() -> None:
    row = {"type": "sensor.camera.rgb", "id": "front", "width": 900, "height": 256, "fov": 100}
    (spec,) = style({**row, "x": 1.3, "y": 0.5, "z": 2.3, "roll": 0.0, "pitch": -10.0, "yaw": 60.0}).sensors()
    assert (spec.kind, spec.id) == ("camera", "front")
    model = read_camera_model(spec)
    assert (model.kind, model.width, model.height, model.fov_deg) == ("rgb", 900, 256, 100.0)
    ahead = model.mount.rotation[:, 0]
    assert (model.mount.x, model.mount.y, model.mount.z) == (1.3, -0.5, 2.3)
    assert ahead[1] < -0.8 and ahead[2] == pytest.approx(-math.sin(math.radians(10.0)))  # to the right and down


@pytest.mark.parametrize(
    ("turn", "option"),
    [(math.pi / 2, RoadOption.LEFT), (-math.pi / 2, RoadOption.RIGHT), (math.radians(30), None), (0.0, None)],
)
def test_bends_are_turns_and_the_rest_follows_its_lane(turn: float, option: RoadOption | None) -> None:
    found = carla_adapter.find_road_options(arc(turn))
    assert set(found) == {RoadOption.LANEFOLLOW} | ({option} if option else set())
    assert found[0] == found[-1] == RoadOption.LANEFOLLOW
    if option:
        assert 10 <= found.count(option) <= 17


@pytest.mark.parametrize(("side", "option"), [(1, RoadOption.CHANGELANELEFT), (-1, RoadOption.CHANGELANERIGHT)])
def test_a_route_that_leaves_its_lane_changes_lanes(side: int, option: RoadOption) -> None:
    x = np.arange(60.0)
    y = side * 3.5 * np.clip((x - 20) / 20, 0, 1)
    found = carla_adapter.find_road_options(briefing(np.column_stack((x, y)), np.zeros(60)))
    assert set(found) == {RoadOption.LANEFOLLOW, option}
    assert found[30] is option and found[10] is found[50] is RoadOption.LANEFOLLOW


def test_the_base_class_thins_the_plan() -> None:
    class Agent(carla_stubs.AutonomousAgent):
        def setup(self, path_to_conf_file: str, ego_vehicles_num: int = 1) -> None:
            self.config = {"control": {"target_point_distance": 10.0}}

    route = [(Transform(Location(float(i), 0.0, 0.0)), RoadOption.LANEFOLLOW) for i in range(36)]
    route[17:19] = [(place, RoadOption.LEFT) for place, _ in route[17:19]]
    agent = Agent("", 1)
    agent.set_global_plan([list(range(36))], [route])
    assert agent._global_plan == [[0, 10, 17, 19, 29, 35]]
    assert [place.location.x for place, _ in agent._global_plan_world_coord[0]] == agent._global_plan[0]
    assert agent._global_plan_all == [list(range(36))]


def test_an_agent_for_one_vehicle_sets_itself_up_with_the_configuration_only() -> None:
    class Agent(carla_stubs.AutonomousAgent):
        def setup(self, path_to_conf_file: str) -> None:  # type: ignore[override]
            self.told = path_to_conf_file

    assert Agent("a.yaml", 2).told == "a.yaml"


def test_names_do_what_they_do_in_carla() -> None:
    assert Location(1.0, 2.0, 3.0) + Vector3D(1.0, 1.0, 1.0) == Location(2.0, 3.0, 4.0)
    assert 2.0 * (Vector3D(3.0, 4.0) - Vector3D()) == Vector3D(6.0, 8.0, 0.0)
    assert Vector3D(3.0, 4.0).length() == Location(3.0, 4.0).distance(Location()) == 5.0
    assert Rotation(90.0).get_forward_vector().z == pytest.approx(1.0)
    assert Track("MAP") is Track.MAP


@pytest.fixture
def no_names() -> Iterator[None]:
    yield
    for name in carla_stubs.MODULES:
        sys.modules.pop(name, None)


@pytest.mark.usefixtures("no_names")
def test_the_names_can_be_imported_once_they_are_installed() -> None:
    carla_stubs.install_stubs()
    import carla  # type: ignore[import-not-found]
    from agents.navigation.local_planner import RoadOption as Option  # type: ignore[import-not-found]
    from leaderboard.autoagents import autonomous_agent  # type: ignore[import-not-found]

    assert carla.VehicleControl is VehicleControl and Option is RoadOption
    assert autonomous_agent.AutonomousAgent is carla_stubs.AutonomousAgent
