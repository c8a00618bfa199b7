"""Builds the observations of all CAVs of an episode from their declared sensors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from mdrive_sumo.contract import Briefing, Message, Objects, Observation, Plan, Privileged, SensorSpec
from mdrive_sumo.contract.exchange import NOTHING
from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import EgoState, Frame
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.weather import Weather
from mdrive_sumo.sensing.localization import OwnStateEstimator, to_own_state
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.sensing.sensor_kinds import SENSOR_KINDS, Sensor, SensorKind, find_kind
from mdrive_sumo.sensing.signal_lamps import SignalLampObserver


@dataclass(frozen=True, slots=True)
class SensorContext:
    """Inputs that all sensors of an episode share."""

    roads: RoadMap
    weather: Weather
    seed: int
    sensing: SensingProfile = SensingProfile.PERFECT

    def derive_track_salt(self, carrier: str) -> int:
        """Return the salt of the track names of a CAV or road-side unit in this episode."""
        return derive_seed(self.seed, "tracks", carrier)


class ObservationBuilder:
    """The sensors of all CAVs."""

    def __init__(
        self, sensors: Mapping[str, tuple[SensorSpec, ...]], briefings: Mapping[str, Briefing], common: SensorContext
    ) -> None:
        """Build all sensors. Raises InputError for unknown or duplicate sensors and for invalid options."""
        self._briefings = briefings
        self._carriers = {ego: _Carrier(ego, specs, briefings[ego], common) for ego, specs in sensors.items()}
        self._estimators = {
            ego: OwnStateEstimator(derive_seed(common.seed, "own-state", ego))
            for ego, carrier in self._carriers.items()
            if common.sensing is SensingProfile.REALISTIC and not carrier.privileged
        }
        """Estimators of the CAVs whose own state is an estimate; the privileged sensor tells the true states anyway."""

    def estimate_own_state(self, frame: Frame, ego: str) -> EgoState:
        """Return the state in which a CAV takes itself to be: its agent plans, and its controller drives, by it."""
        estimator, truth = self._estimators.get(ego), frame.egos[ego]
        return truth if estimator is None else estimator.estimate(frame.tick, truth)

    def needs_frame(self, egos: tuple[str, ...]) -> bool:
        """Return whether any of these CAVs has a sensor."""
        return any(self._carriers[ego].has_sensors for ego in egos)

    def build_observations(
        self,
        frame: Frame,
        scene: SensingFrame | None,
        plans: Mapping[str, Plan],
        messages_by_ego: Mapping[str, tuple[Message, ...]],
    ) -> dict[str, Observation]:
        """Return the observations of the frame for the CAVs in `messages_by_ego`.

        plans: latest plan by CAV, for privileged sensors. A CAV that ended in this frame is still visible: it leaves
        the world with the next tick.
        """
        rows = {ego: row for row, ego in enumerate(frame.egos)} if scene is not None else {}
        observations: dict[str, Observation] = {}
        privileged: Privileged | None = None  # the same for all CAVs
        for ego, messages in messages_by_ego.items():
            state, carrier, estimator = frame.egos[ego], self._carriers[ego], self._estimators.get(ego)
            estimate = None if estimator is None else estimator.estimate(frame.tick, state)
            own = to_own_state(state) if estimator is None or estimate is None else estimator.describe(estimate)
            lights = carrier.read_lights(frame.signals)
            if scene is None or not carrier.has_sensors:
                observations[ego] = Observation(frame.tick, own, signals=lights, messages=messages)
                continue
            eye = build_frozen(SensorPose, state.x, state.y, state.yaw, rows[ego], estimate)
            fields = carrier.sense(scene, eye)
            if carrier.privileged:
                fields["privileged"] = privileged = privileged or self._privileged(scene, plans)
            observation = Observation(frame.tick, own, signals=lights, messages=messages, **fields)
            if carrier.objects_sensor is not None:
                observation.defer(partial(_sense_or_void, carrier.objects_sensor.defer(scene, eye)))
            observations[ego] = observation
        return observations

    def _privileged(self, scene: SensingFrame, plans: Mapping[str, Plan]) -> Privileged:
        egos = sorted(scene.egos, key=lambda ego: self._briefings[ego].ego_id)
        return Privileged(
            ego_ids=tuple(self._briefings[ego].ego_id for ego in egos),
            states=tuple(to_own_state(scene.egos[ego]) for ego in egos),
            routes=tuple(self._briefings[ego].route_xy for ego in egos),
            plans=tuple(plans.get(ego) for ego in egos),
            objects=scene.boxes.take(slice(len(scene.egos), None)),
            rooms=tuple(self._briefings[ego].route_room for ego in egos),
            speed_limits=tuple(self._briefings[ego].route_speed_limit for ego in egos),
        )


class _Carrier:
    """The sensors of one CAV."""

    def __init__(self, ego: str, specs: tuple[SensorSpec, ...], briefing: Briefing, common: SensorContext) -> None:
        self.has_sensors = bool(specs)
        self.privileged = False
        """Whether one of the sensors knows everything."""
        self._single: dict[str, Sensor] = {}
        """Each sensor by the field of `Observation` that it fills."""
        self._named: dict[str, dict[str, Sensor]] = {}
        """Each sensor by that field and its id."""
        self._lights = [_split_light(light.id) for light in briefing.traffic_lights]
        """Id, traffic light of SUMO and place in its state, of every light of the briefing."""
        self._drawn: tuple[SensingFrame, Objects] | None = None
        """What `_look` returned last, and for which frame: several sensors draw it."""
        salt = common.derive_track_salt(ego)
        for spec in specs:
            seed = derive_seed(common.seed, "sensor", ego, spec.kind, spec.id)
            standard = common.sensing.standard_detector
            setup = SensorSetup(ego, seed, common.roads, common.weather, briefing, salt, standard, self._look)
            self._add(find_kind(spec), spec, setup)
        # The ideal detector reaches as far as the sensor that draws the farthest.
        drawn_m = max((spec.range_m for spec in specs if SENSOR_KINDS[spec.kind].draws_ideal_sight), default=None)
        ideal = SensorSetup(ego, 0, common.roads, common.weather, briefing, salt)
        self._sight = None if drawn_m is None else ObjectsSensor(SensorSpec("objects", range_m=drawn_m), ideal)
        objects = self._single.pop("objects", None)
        self.objects_sensor = objects if isinstance(objects, ObjectsSensor) else None
        """Computes only what an agent reads (`Observation.defer`)."""

    def _add(self, kind: SensorKind, spec: SensorSpec, setup: SensorSetup) -> None:
        if kind.build is None:
            self.privileged |= kind.knows_everything
            return
        key, sensors = kind.field, self._single
        if kind.is_named:
            key, sensors = spec.id, self._named.setdefault(kind.field, {})
        if key in sensors:
            raise InputError(f"sensor {spec.kind!r}: expected one of this kind and id, found two with id {spec.id!r}")
        sensors[key] = kind.build(spec, setup)

    def _look(self, scene: SensingFrame, eye: SensorPose) -> Objects:
        """Return what an ideal detector sees, once per frame."""
        assert self._sight is not None, "a sensor that draws what is in sight has it"
        if self._drawn is None or self._drawn[0] is not scene:
            self._drawn = scene, self._sight.sense(scene, eye)
        return self._drawn[1]

    def read_lights(self, signals: Mapping[str, str]) -> Mapping[str, str]:
        """Return the state letter of every traffic light of the briefing, by its id."""
        if not self._lights:
            return NOTHING
        return MappingProxyType({light: signals[name][place] for light, name, place in self._lights})

    def sense(self, scene: SensingFrame, eye: SensorPose) -> dict[str, Any]:
        """Return the sensor fields of the observation but `objects`."""
        fields: dict[str, Any] = {field: sensor.sense(scene, eye) for field, sensor in self._single.items()}
        for field, sensors in self._named.items():
            measured = {name: sensor.sense(scene, eye) for name, sensor in sensors.items()}
            fields[field] = MappingProxyType({name: value for name, value in measured.items() if value is not None})
        return fields


def _sense_or_void(sense: Callable[[], Objects]) -> Objects:
    """Return the detections, also while an agent runs. Raises WorldError: a failure here is none of the agent's."""
    try:
        return sense()
    except Exception as error:
        raise WorldError(f"objects sensor: {type(error).__name__}: {error}") from error


def build_sensing_frame(
    frame: Frame, sizes: Mapping[str, tuple[float, float]], lamps: SignalLampObserver | None = None
) -> SensingFrame:
    """Return all road users of the frame, CAVs first; sizes: (length, width) [m] by CAV id.

    lamps: what lights brake lamps and indicators, if there are cameras; it wants every frame of an episode.
    """
    boxes = Objects.from_egos(frame.egos, sizes).concat(frame.actors)
    shining = lamps.observe(frame.tick, boxes) if lamps is not None else {}
    return SensingFrame(frame.tick, boxes, frame.egos, frame.signals, signal_lamps=shining)


def _split_light(light: str) -> tuple[str, str, int]:
    name, _, place = light.rpartition(":")
    return light, name, int(place)
