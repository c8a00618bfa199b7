"""Road-side units of a scenario, which send their detections as CPM."""

from collections.abc import Sequence

from mdrive_sumo.contract import Message, SensorSpec
from mdrive_sumo.contract.detector_profiles import IDEAL, PROFILES, DetectionProfile
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor
from mdrive_sumo.sensing.observation_builder import SensorContext
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.v2x.awareness_service import build_cpm, count_fitting_objects, take_due
from mdrive_sumo.v2x.messages import MAX_OBJECTS, Cpm, ReferencePose, encode
from mdrive_sumo.v2x.services.cpm_rule import CpmRule
from mdrive_sumo.v2x.services.sending_rate import SendingRate

CPM_INTERVAL_TICKS = 2
"""CPMs at 10 Hz, the highest rate of ETSI TS 103 324; under `--v2x-rate etsi` its rules are checked as often."""


class RoadsideUnits:
    """All road-side units of an episode."""

    def __init__(
        self, units: Sequence[RoadsideUnit], common: SensorContext, rate: SendingRate = SendingRate.FIXED
    ) -> None:
        """Raises InputError for an unknown error profile."""
        self._units = tuple(units)
        self._sensors = [_build_sensor(unit, common) for unit in units]
        self._profiles = [PROFILES[find_detector(unit, common.sensing)] for unit in units]
        self._rules = [None if rate is SendingRate.FIXED else CpmRule(profile) for profile in self._profiles]

    @property
    def positions(self) -> dict[str, tuple[float, float]]:
        """Positions of the units [m] by id."""
        return {unit.id: (unit.x, unit.y) for unit in self._units}

    def is_due(self, tick: int) -> bool:
        """Return whether the units send in this tick."""
        return bool(self._units) and tick % CPM_INTERVAL_TICKS == 0

    def compose_messages(self, scene: SensingFrame) -> dict[str, tuple[Message, ...]]:
        """Return the CPM of every unit that sends one, by its id."""
        stations = zip(self._units, self._sensors, self._profiles, self._rules, strict=True)
        contents = {
            unit.id: _compose_cpm(unit, sensor, scene, profile, rule) for unit, sensor, profile, rule in stations
        }
        return {name: (encode(cpm),) for name, cpm in contents.items() if cpm is not None}


def _build_sensor(unit: RoadsideUnit, common: SensorContext) -> ObjectsSensor:
    detector = find_detector(unit, common.sensing)
    spec = SensorSpec("objects", range_m=unit.range_m, options={"profile": detector, "free_space": True})
    seed = derive_seed(common.seed, "sensor", unit.id)
    salt = common.derive_track_salt(unit.id)
    return ObjectsSensor(spec, SensorSetup(unit.id, seed, common.roads, common.weather, None, salt))


def find_detector(unit: RoadsideUnit, sensing: SensingProfile) -> str:
    """Return the error profile of a unit's detections.

    A scenario that says `ideal` (the default) leaves the choice to the sensing profile, so that units see as well as
    cars do; under `perfect` all units are ideal.
    """
    is_open = unit.profile == IDEAL or sensing is SensingProfile.PERFECT
    return sensing.standard_detector if is_open else unit.profile


def _compose_cpm(
    unit: RoadsideUnit, sensor: ObjectsSensor, scene: SensingFrame, profile: DetectionProfile, rule: CpmRule | None
) -> Cpm | None:
    """Return a unit's CPM, None if its rule says that none is due; its surveyed position is exact."""
    objects = sensor.sense(scene, SensorPose(unit.x, unit.y, 0.0, None))
    if len(objects) > MAX_OBJECTS:
        objects = objects.take(slice(MAX_OBJECTS))  # the nearest
    if rule is not None:
        due = rule.check(scene.tick, objects, count_fitting_objects(objects))
        if due is None:
            return None
        objects = take_due(objects, due)
    pose = ReferencePose(unit.x, unit.y, 0.0, scene.tick)
    return build_cpm(pose, unit.range_m, objects, profile, roadside=True)
