"""GNSS, IMU and speedometer, and the error for an agent that declares a camera."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.worlds import straight_road

from mdrive_sumo.contract import Objects, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import EgoState
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.navigation_sensors import GnssSensor, ImuSensor, SpeedometerSensor, to_compass, to_gnss, to_xy
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup
from mdrive_sumo.sensing.sensor_kinds import describe_camera_error

EGO = EgoState(12.0, -34.0, 0.5, speed=8.0, acceleration=-1.5, yaw_rate=0.25)
FITTING = SensorSetup("a", 7, straight_road(), WEATHERS["default"], None)
EYE = SensorPose(EGO.x, EGO.y, EGO.yaw, 0)


def scene(tick: int = 0) -> SensingFrame:
    none = np.zeros(0)
    return SensingFrame(
        tick, Objects((), np.zeros(0, dtype=np.uint8), *(none,) * 6), {"b": EgoState(0, 0, 0, 0), "a": EGO}
    )


def spec(kind: str, **options: float | str | bool) -> SensorSpec:
    return SensorSpec(kind, options=options)


@given(st.floats(-20_000, 20_000), st.floats(-20_000, 20_000))
def test_positions_come_back_to_a_millimetre(x: float, y: float) -> None:
    assert to_xy(to_gnss(x, y)) == pytest.approx((x, y), abs=1e-3)


def test_latitude_grows_to_the_north_and_longitude_to_the_east() -> None:
    assert (to_gnss(0.0, 0.0).latitude_deg, to_gnss(0.0, 0.0).longitude_deg) == (0.0, 0.0)
    degree = math.pi / 180 * 6_378_137.0
    assert to_gnss(degree, 0.0).longitude_deg == pytest.approx(1.0)
    assert to_gnss(0.0, 100.0).latitude_deg == pytest.approx(100.0 / degree, rel=1e-9)
    # Mercator's formula as CARLA's leaderboard has it, at reference latitude 0
    assert to_gnss(0.0, 3e5).latitude_deg == pytest.approx(360 / math.pi * math.atan(math.exp(3e5 / 6_378_137.0)) - 90)


def test_a_receiver_without_noise_measures_the_box_centre() -> None:
    read = GnssSensor(spec("gnss"), FITTING).sense(scene(), EYE)
    assert to_xy(read) == pytest.approx((EGO.x, EGO.y), abs=1e-6)
    assert read.altitude_m == 0.0


@pytest.mark.parametrize(
    ("yaw", "compass"), [(math.pi / 2, 0.0), (0.0, math.pi / 2), (-math.pi / 2, math.pi), (math.pi, 1.5 * math.pi)]
)
def test_the_compass_turns_clockwise_from_north(yaw: float, compass: float) -> None:
    assert to_compass(yaw) == pytest.approx(compass)


@given(st.floats(-10, 10))
def test_the_compass_stays_below_a_full_turn(yaw: float) -> None:
    assert 0.0 <= to_compass(yaw) < 2 * math.pi
    assert math.cos(to_compass(yaw)) == pytest.approx(math.sin(yaw), abs=1e-9)


def test_a_compass_just_left_of_north_reads_zero_not_a_full_turn() -> None:
    assert to_compass(math.nextafter(math.pi / 2, 2.0)) == 0.0


def test_an_inertial_unit_without_noise_measures_the_motion() -> None:
    read = ImuSensor(spec("imu"), FITTING).sense(scene(), EYE)
    assert read.acceleration == (-1.5, 8.0 * 0.25, 9.81)
    assert read.angular_rate == (0.0, 0.0, 0.25)
    assert read.compass == pytest.approx(math.pi / 2 - 0.5)


def test_a_car_at_rest_feels_gravity_only() -> None:
    still = replace(scene(), egos={"a": EgoState(0.0, 0.0, 0.0, 0.0)})
    assert ImuSensor(spec("imu"), FITTING).sense(still, SensorPose(0.0, 0.0, 0.0, 0)).acceleration == (0.0, 0.0, 9.81)


def test_the_speedometer_measures_the_speed_of_its_carrier() -> None:
    assert SpeedometerSensor(spec("speedometer"), FITTING).sense(scene(), EYE) == 8.0


def test_gnss_noise_has_its_size_and_no_bias() -> None:
    sensor = GnssSensor(spec("gnss", noise_m=2.0), FITTING)
    reads = [sensor.sense(scene(tick), EYE) for tick in range(2000)]
    errors = np.array([(*to_xy(read), read.altitude_m) for read in reads]) - (EGO.x, EGO.y, 0.0)
    assert errors.std(axis=0) == pytest.approx(2.0, rel=0.06)
    assert errors.mean(axis=0) == pytest.approx(0.0, abs=0.2)
    assert np.abs(np.corrcoef(errors.T) - np.eye(3)).max() < 0.1


def test_imu_noise_has_its_sizes() -> None:
    options = {"noise_acceleration": 0.3, "noise_gyro": 0.02, "noise_compass_deg": 5.0}
    sensor = ImuSensor(spec("imu", **options), FITTING)
    reads = [sensor.sense(scene(tick), EYE) for tick in range(2000)]
    accelerations = np.array([read.acceleration for read in reads])
    assert accelerations.std(axis=0) == pytest.approx(0.3, rel=0.06)
    assert accelerations.mean(axis=0) == pytest.approx((-1.5, 2.0, 9.81), abs=0.03)
    assert np.std([read.angular_rate for read in reads], axis=0) == pytest.approx(0.02, rel=0.06)
    assert np.rad2deg(np.std([read.compass for read in reads])) == pytest.approx(5.0, rel=0.06)


def test_one_noise_does_not_bring_the_others() -> None:
    read = ImuSensor(spec("imu", noise_gyro=0.1), FITTING).sense(scene(), EYE)
    assert read.acceleration == (-1.5, 2.0, 9.81)
    assert read.angular_rate[2] != 0.25


def test_noise_depends_on_seed_and_tick_only() -> None:
    sensor = GnssSensor(spec("gnss", noise_m=1.0), FITTING)
    forward = [sensor.sense(scene(tick), EYE) for tick in range(5)]
    again = GnssSensor(spec("gnss", noise_m=1.0), FITTING)
    assert forward == [again.sense(scene(tick), EYE) for tick in reversed(range(5))][::-1]
    assert len(set(forward)) == 5
    other = GnssSensor(spec("gnss", noise_m=1.0), replace(FITTING, seed=8))
    assert other.sense(scene(), EYE) != forward[0]


@pytest.mark.parametrize(
    ("sensor", "asked", "said"),
    [
        (GnssSensor, spec("gnss", noise=1.0), "sensor 'gnss': expected one of noise_m, found option 'noise'"),
        (GnssSensor, spec("gnss", noise_m=-1.0), "'noise_m': expected a number in .0, 1000., found -1.0"),
        (GnssSensor, spec("gnss", noise_m=math.inf), "'noise_m': .*found inf"),
        (ImuSensor, spec("imu", noise_gyro=True), "'noise_gyro': .*found True"),
        (ImuSensor, spec("imu", noise_compass_deg="much"), "'noise_compass_deg': .*found 'much'"),
        (ImuSensor, spec("imu", noise_m=1.0), "noise_acceleration, noise_compass_deg, noise_gyro, found .*'noise_m'"),
        (SpeedometerSensor, spec("speedometer", noise_m=1.0), "sensor 'speedometer': expected no options, found"),
    ],
)
def test_bad_options_are_named(sensor: type[GnssSensor], asked: SensorSpec, said: str) -> None:
    with pytest.raises(InputError, match=said):
        sensor(asked, FITTING)


@pytest.mark.parametrize(
    "kind", ["rgb", "sensor.camera.rgb", "sensor.camera.depth", "depth", "semantic", "CAM_FRONT", "Camera"]
)
def test_the_error_for_another_name_of_a_camera_tells_the_right_one(kind: str) -> None:
    said = describe_camera_error(kind)
    assert repr(kind) in said
    assert 'the sensor "camera"' in said
    assert all(f'"{image}"' in said for image in ("rgb", "semantic", "depth", "instance"))
    assert "\n" not in said


@pytest.mark.parametrize(
    "kind",
    ["objects", "lidar", "bev", "gnss", "imu", "speedometer", "privileged", "sensor.lidar.ray_cast", "radar", ""],
)
def test_other_kinds_are_no_cameras(kind: str) -> None:
    assert describe_camera_error(kind) == ""
