"""Road-side units of a scenario, which send their detections as CPM."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.contract import Message, SensorSpec
from mdrive_sumo.contract.detector_profiles import PROFILES
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor
from mdrive_sumo.sensing.observation_builder import SensorContext
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup
from mdrive_sumo.v2x.messages import MAX_OBJECTS, Cpm, ReferencePose, encode

CPM_INTERVAL_TICKS = 2
"""CPMs at 10 Hz, the highest rate of ETSI TS 103 324."""


class RoadsideUnits:
    """All road-side units of an episode."""

    def __init__(self, units: Sequence[RoadsideUnit], common: SensorContext) -> None:
        """Raises InputError for an unknown error profile."""
        self._units = tuple(units)
        self._sensors = [_build_sensor(unit, common) for unit in units]

    @property
    def positions(self) -> dict[str, tuple[float, float]]:
        """Positions of the units [m] by id."""
        return {unit.id: (unit.x, unit.y) for unit in self._units}

    def is_due(self, tick: int) -> bool:
        """Return whether the units send in this tick."""
        return bool(self._units) and tick % CPM_INTERVAL_TICKS == 0

    def compose_messages(self, scene: SensingFrame) -> dict[str, tuple[Message, ...]]:
        """Return the CPM of every unit by its id."""
        return {
            unit.id: (_compose_cpm(unit, sensor, scene),)
            for unit, sensor in zip(self._units, self._sensors, strict=True)
        }


def _build_sensor(unit: RoadsideUnit, common: SensorContext) -> ObjectsSensor:
    spec = SensorSpec("objects", range_m=unit.range_m, options={"profile": unit.profile, "free_space": True})
    seed = derive_seed(common.seed, "sensor", unit.id)
    salt = common.derive_track_salt(unit.id)
    return ObjectsSensor(spec, SensorSetup(unit.id, seed, common.roads, common.weather, None, salt))


def _compose_cpm(unit: RoadsideUnit, sensor: ObjectsSensor, scene: SensingFrame) -> Message:
    objects = sensor.sense(scene, SensorPose(unit.x, unit.y, 0.0, None))
    objects = objects.take(slice(MAX_OBJECTS))  # the nearest
    age = np.full(len(objects.ids), PROFILES[unit.profile].latency_ticks, dtype=np.uint8)
    return encode(Cpm(ReferencePose(unit.x, unit.y, 0.0, scene.tick), unit.range_m, objects, age, roadside=True))
