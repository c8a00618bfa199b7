"""Senses: the declared sensors of every CAV of an episode, applied to one scene after the other."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from mdrive_sumo.contract import Briefing, Message, Objects, Observation, OwnState, Plan, Privileged, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import EgoState, Frame
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.weather import Weather
from mdrive_sumo.sensing.cameras import describe_camera_error
from mdrive_sumo.sensing.lidar_sensor import LidarSensor
from mdrive_sumo.sensing.navigation_sensors import GnssSensor, ImuSensor, SpeedometerSensor
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor
from mdrive_sumo.sensing.raster_sensor import RasterSensor
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup

SINGLE: Mapping[str, Callable[[SensorSpec, SensorSetup], Any]] = MappingProxyType(
    {"objects": ObjectsSensor, "gnss": GnssSensor, "imu": ImuSensor, "speedometer": SpeedometerSensor}
)
"""Kinds of which a CAV has one at most; each fills the observation's field of that name."""
KINDS = (*SINGLE, "lidar", "bev", "privileged")


@dataclass(frozen=True, slots=True)
class SensorContext:
    """What all sensors of an episode have in common."""

    roads: RoadMap
    weather: Weather
    seed: int


class ObservationBuilder:
    """The sensors of every CAV."""

    def __init__(
        self, sensors: Mapping[str, tuple[SensorSpec, ...]], briefings: Mapping[str, Briefing], common: SensorContext
    ) -> None:
        """Raises InputError for a sensor that does not exist, or twice the same, or with options it does not have."""
        self._briefings = briefings
        self._carriers = {ego: _Carrier(specs, briefings[ego], common) for ego, specs in sensors.items()}

    def needs_frame(self, egos: tuple[str, ...]) -> bool:
        """Whether any of these CAVs looks at anything."""
        return any(self._carriers[ego].looks for ego in egos)

    def build_observations(
        self,
        frame: Frame,
        scene: SensingFrame | None,
        plans: Mapping[str, Plan],
        heard: Mapping[str, tuple[Message, ...]],
    ) -> dict[str, Observation]:
        """What the CAVs that are named in `heard`, each with its messages, see of the frame.

        plans: the CAVs' latest, for whoever is privileged. A CAV that ended in this frame is seen once more: it leaves
        the world with the coming tick.
        """
        rows = {ego: row for row, ego in enumerate(frame.egos)}
        observations: dict[str, Observation] = {}
        for ego, messages in heard.items():
            state, carrier = frame.egos[ego], self._carriers[ego]
            lights = {light.id: _letter(frame.signals, light.id) for light in self._briefings[ego].traffic_lights}
            seen: dict[str, Any] = {}
            if scene is not None and carrier.looks:
                seen = carrier.sense(scene, SensorPose(state.x, state.y, state.yaw, rows[ego]))
                if carrier.privileged:
                    seen["privileged"] = self._privileged(scene, plans)
            observations[ego] = Observation(
                frame.tick, to_own_state(state), signals=MappingProxyType(lights), messages=messages, **seen
            )
        return observations

    def _privileged(self, scene: SensingFrame, plans: Mapping[str, Plan]) -> Privileged:
        ids = tuple(sorted(scene.egos))
        return Privileged(
            ego_ids=ids,
            states=tuple(to_own_state(scene.egos[ego]) for ego in ids),
            routes=tuple(self._briefings[ego].route_xy for ego in ids),
            plans=tuple(plans.get(ego) for ego in ids),
            objects=scene.boxes.take(slice(len(scene.egos), None)),
            rooms=tuple(self._briefings[ego].route_room for ego in ids),
        )


class _Carrier:
    """The sensors of one CAV."""

    def __init__(self, specs: tuple[SensorSpec, ...], briefing: Briefing, common: SensorContext) -> None:
        self._single: dict[str, Any] = {}
        self._lidar: dict[str, LidarSensor] = {}
        self._bev: dict[str, RasterSensor] = {}
        self.privileged = any(spec.kind == "privileged" for spec in specs)
        self.looks = bool(specs)
        for spec in specs:
            seed = derive_seed(common.seed, "sensor", briefing.ego_id, spec.kind, spec.id)
            self._add(spec, SensorSetup(briefing.ego_id, seed, common.roads, common.weather, briefing))
        # What may be drawn is what a perfect detector sees: a raster must not see through walls.
        view = max((spec.range_m for spec in specs if spec.kind == "bev"), default=0.0)
        ideal = SensorSetup(briefing.ego_id, 0, common.roads, common.weather, briefing)
        self._sight = ObjectsSensor(SensorSpec("objects", range_m=view), ideal) if self._bev else None

    def _add(self, spec: SensorSpec, fitting: SensorSetup) -> None:
        if spec.kind in SINGLE:
            _new(self._single, spec.kind, spec)[spec.kind] = SINGLE[spec.kind](spec, fitting)
        elif spec.kind == "lidar":
            _new(self._lidar, spec.id, spec)[spec.id] = LidarSensor(spec, fitting)
        elif spec.kind == "bev":
            _new(self._bev, spec.id, spec)[spec.id] = RasterSensor(spec, fitting)
        elif spec.kind != "privileged":
            raise InputError(describe_camera_error(spec.kind) or _unknown(spec.kind))

    def sense(self, scene: SensingFrame, eye: SensorPose) -> dict[str, Any]:
        """Fields of the observation."""
        seen: dict[str, Any] = {kind: sensor.sense(scene, eye) for kind, sensor in self._single.items()}
        scans = {name: sensor.sense(scene, eye) for name, sensor in self._lidar.items()}
        if scans:
            seen["lidar"] = MappingProxyType({name: scan for name, scan in scans.items() if scan is not None})
        if self._sight is not None:
            visible = self._sight.sense(scene, eye)
            seen["bev"] = MappingProxyType(
                {name: sensor.sense(scene, eye, visible) for name, sensor in self._bev.items()}
            )
        return seen


def _new(sensors: dict[str, Any], key: str, spec: SensorSpec) -> dict[str, Any]:
    if key in sensors:
        raise InputError(f"sensor {spec.kind!r}: expected one of this kind and id, found two with id {spec.id!r}")
    return sensors


def _unknown(kind: str) -> str:
    return f"sensor {kind!r}: expected one of {', '.join(KINDS)}, found none of that kind"


def build_sensing_frame(frame: Frame, sizes: Mapping[str, tuple[float, float]]) -> SensingFrame:
    """Every road user of the frame, CAVs first; sizes: (length, width) [m] of the CAVs."""
    boxes = Objects.from_egos(frame.egos, sizes).concat(frame.actors)
    return SensingFrame(frame.tick, boxes, frame.egos)


def to_own_state(ego: EgoState) -> OwnState:
    """The ego's own instruments."""
    return OwnState(ego.x, ego.y, ego.yaw, ego.speed, ego.acceleration, ego.yaw_rate, ego.steer_angle)


def _letter(signals: Mapping[str, str], light: str) -> str:
    name, _, index = light.rpartition(":")
    return signals[name][int(index)]
