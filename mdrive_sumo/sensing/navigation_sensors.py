"""Satellite receiver, inertial unit and speedometer: all at the origin of the car, its box centre, in every tick.

They report the estimated own state, which is exact under the sensing profile `perfect`; options add noise to it. The
map projection is the one of CARLA's leaderboard: spherical Mercator on the equatorial radius of WGS 84, multiplied by
cos(reference latitude). The reference is (0, 0) and lies at the origin of the network's frame, so that the factor is 1;
x points east and y north.
"""

import math

from mdrive_sumo.contract import Gnss, Imu, SensorSpec
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU
from mdrive_sumo.core.seeding import draw_normals
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup
from mdrive_sumo.sensing.sensor_options import check_option_names, read_number

EARTH_RADIUS_M = 6_378_137.0
"""Equatorial radius of WGS 84."""
GRAVITY = 9.81
"""[m/s2]"""
MAX_NOISE = 1000.0
"""Largest standard deviation that an option accepts, in the unit of the option: far beyond any instrument."""


def to_gnss(x: float, y: float) -> Gnss:
    """Return the WGS 84 position of the point (x, y) [m] of the world frame; roads are flat, at altitude 0."""
    latitude = 2 * portable.atan(portable.exp(y / EARTH_RADIUS_M)) - math.pi / 2
    return Gnss(math.degrees(latitude), math.degrees(x / EARTH_RADIUS_M), 0.0)


def to_xy(gnss: Gnss) -> tuple[float, float]:
    """Return the point [m] of the world frame for a receiver position: the inverse of `to_gnss`, for agents."""
    y = EARTH_RADIUS_M * portable.log(portable.tan(math.pi / 4 + math.radians(gnss.latitude_deg) / 2))
    return EARTH_RADIUS_M * math.radians(gnss.longitude_deg), y


def to_compass(yaw: float) -> float:
    """The compass [rad], clockwise from north in [0, 2 pi), of a car that heads for yaw [rad]."""
    compass = (math.pi / 2 - yaw) % TAU
    return compass if compass < TAU else 0.0  # a tiny negative angle is rounded to a full turn


class GnssSensor:
    """Satellite receiver. Option noise_m: standard deviation [m] of each of east, north and up, new in every tick."""

    def __init__(self, spec: SensorSpec, fitting: SensorSetup) -> None:
        """Raises InputError."""
        check_option_names(spec, ("noise_m",))
        self._noise_m = read_number(spec, "noise_m", 0.0, 0.0, MAX_NOISE)
        self._seed = fitting.seed

    def sense(self, scene: SensingFrame, eye: SensorPose) -> Gnss:
        """Return the measured position of the box centre."""
        own = eye.estimate or eye
        if not self._noise_m:
            return to_gnss(own.x, own.y)
        east, north, up, *_ = (self._noise_m * value for value in draw_normals(self._seed, "gnss", scene.tick))
        read = to_gnss(own.x + east, own.y + north)
        return Gnss(read.latitude_deg, read.longitude_deg, up)


class ImuSensor:
    """Inertial unit. Options: standard deviations noise_acceleration [m/s2], noise_gyro [rad/s], noise_compass_deg.

    The car moves in a plane: it is accelerated along yaw and, as it turns, by speed * yaw rate to the left.
    """

    def __init__(self, spec: SensorSpec, fitting: SensorSetup) -> None:
        """Raises InputError."""
        names = ("noise_acceleration", "noise_gyro", "noise_compass_deg")
        check_option_names(spec, names)
        sigmas = [read_number(spec, name, 0.0, 0.0, MAX_NOISE) for name in names]
        self._acceleration, self._gyro, self._compass = sigmas[0], sigmas[1], math.radians(sigmas[2])
        self._noisy = any(sigmas)
        self._carrier, self._seed = fitting.carrier, fitting.seed

    def sense(self, scene: SensingFrame, eye: SensorPose) -> Imu:
        """Return the readings of this tick."""
        ego = eye.estimate or scene.egos[self._carrier]
        drawn = draw_normals(self._seed, "imu", scene.tick) if self._noisy else (0.0,) * 8
        a, g = self._acceleration, self._gyro
        return Imu(
            acceleration=(
                ego.acceleration + a * drawn[0],
                ego.speed * ego.yaw_rate + a * drawn[1],
                GRAVITY + a * drawn[2],
            ),
            angular_rate=(g * drawn[3], g * drawn[4], ego.yaw_rate + g * drawn[5]),
            compass=to_compass(ego.yaw + self._compass * drawn[6]),
        )


class SpeedometerSensor:
    """Speedometer. It has no options."""

    def __init__(self, spec: SensorSpec, fitting: SensorSetup) -> None:
        """Raises InputError."""
        check_option_names(spec, ())
        self._carrier = fitting.carrier

    def sense(self, scene: SensingFrame, eye: SensorPose) -> float:
        """Return the speed [m/s] along yaw."""
        return (eye.estimate or scene.egos[self._carrier]).speed
