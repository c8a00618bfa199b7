"""Certificates of need: what no CAV without messages can do, whatever its planner.

Take a CAV, another road user whose drive crosses its route, and the worlds in which the road user makes its drive of
the reference earlier or later by whole ticks, or never comes. All else is as in the reference. Theorem, of a conflict
with `excludes_all`: a driver of the CAV without messages that is in time where the road user never comes collides with
it in one of the worlds. Of a conflict with `is_blind` the same holds of all drivers that are no slower than
`required_speed` from where a CAV of that speed can last stop until the zone is left. In both cases another station has
seen the road user 0.2 s before that moment or earlier: a message can prevent the collision.

Proof. In the world without the road user the driver passes the zone, so its drive leads through the grid of stations
and speeds in `need.crossing_search`. Sides of the grid are closed if their states are doomed (`need.doom`): for some
start of the road user, no place where the CAV can have been at an earlier tick sees it, so the driver has done the
same as without it; and after the state neither full braking nor full acceleration, of the CAV or of a vehicle that
reacts as soon as it can see the CAV, keeps both apart. If no way through open sides is in time, every drive in time
leads through a doomed state.

Assumptions: the CAV stays within 0.25 m of its route and the speed limits, looks from its box centre, and sees
whatever is not hidden, to 1000 m and at any share. Only buildings and what stands still for whole half seconds hide
anything: in the plane, as for the objects sensor, cars and high props do; `is_blind_over_roofs` asks the same of the
LiDAR on the roof. Vehicles brake with 9 m/s2 once they can see the CAV; pedestrians and cyclists keep their course. A
road user that exists in the first tick waits at its start if it leaves later.

What it does not say: that a driver fails in the scenario as written, whose start it may meet by luck; anything about
drivers that leave their route, mount a LiDAR elsewhere, or, for `is_blind`, spend their spare time before this zone.
Bounds err on the side of not certifying, except where time is sampled: boxes are compared at recorded ticks, and a
witness's line of sight at both ends of half a second. Other traffic moves as in the reference in all worlds.

For `validate` and `generate --hard`: `certify_need` takes the scenario with its time limits and the reference drive;
`holds` is what the hard tier counts; `save_need`, `read_need` and `load_need` handle `need.json` as those of
`study.occlusion_certificate` handle `occlusion.json`. Other time limits make other certificates.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.geometry import wrap_angles
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, Scenario, load_model
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks
from mdrive_sumo.sensing.visibility import BuildingEdges
from mdrive_sumo.study.need.conflict_zone import ConflictZone, ZoneFinder
from mdrive_sumo.study.need.crossing_search import CrossingSearch, SafeCrossing
from mdrive_sumo.study.need.doom import DoomTest
from mdrive_sumo.study.need.message_lead import ReferenceDrive, Witnesses
from mdrive_sumo.study.need.motion import MotionLimits, RouteMotion, build_route_motion
from mdrive_sumo.study.need.occluders import StandingVehicles
from mdrive_sumo.study.need.sight_tables import SightTables

NEED_FILE = "need.json"
COMFORT = 2.0
"""Lateral acceleration [m/s2] up to which a curve does not lower the required speed."""
REACHED_SHARE = 0.8
"""The required speed is at most this share of the greatest speed that the CAV can have at the zone."""
CURVE_M = 10.0
"""Length of route before the zone on which a curve counts."""
CURVE_STEPS = 5
"""Metres over which a curvature is the mean."""


class _FilePart(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class NeedConflict(_FilePart):
    """A CAV and another road user whose drives cross, and what the CAV can do there without messages."""

    ego: str
    road_user: str
    x: float
    """Of the CAV's centre where the conflict zone begins [m]."""
    y: float
    time_limit_s: float
    required_speed: float
    """Mean speed [m/s] that the time limit requires of the CAV, less in a curve."""
    is_blind: bool
    """Whether every drive that is no slower than the required speed in the approach is doomed for some start of the
    road user."""
    is_blind_over_roofs: bool
    """Whether this is also true of a LiDAR on the roof, from which only buildings, lorries and buses hide anything."""
    cautious_s: float | None
    """Least arrival time [s] of a driver without messages that is not doomed, however slow; a lower bound. None if
    there is none within 10 s of the limit."""
    cautious_speed: float | None
    """The speed [m/s] at most, where this driver is slowest because of the conflict."""
    excludes_all: bool
    """Whether no driver without messages, however slow here and fast elsewhere, is safe for all starts and in time."""
    conflict_s: float
    """When the road user enters the zone in the reference drive."""
    stopping_s: float | None = None
    """Last tick of the reference drive at which the CAV could stop before the zone. This and what follows is given if
    the conflict is blind."""
    own_sight_s: float | None = None
    """First tick of the reference drive at which a sensor of the CAV sees the road user; None: not before the zone."""
    told_s: float | None = None
    """First tick of the reference drive at which a station could tell of the road user."""
    stations: tuple[str, ...] = ()
    """Those that could before `stopping_s`: the road user itself if it is a CAV, other CAVs and road-side units."""
    lead_s: float = 0.0
    """How many seconds earlier than its own sensors a message tells the CAV of the road user in the reference drive."""


class NeedCertificate(_FilePart):
    """All conflicts of a scenario."""

    scenario: str
    conflicts: tuple[NeedConflict, ...]

    @property
    def holds(self) -> bool:
        """Whether a conflict is blind at the speed that the time limit requires."""
        return any(conflict.is_blind for conflict in self.conflicts)

    @property
    def excludes_all(self) -> bool:
        """Whether a conflict excludes drivers without messages of any speed."""
        return any(conflict.excludes_all for conflict in self.conflicts)

    @property
    def lead_s(self) -> float:
        """The most seconds that a message gains in a blind conflict; 0 without one."""
        return max((conflict.lead_s for conflict in self.conflicts if conflict.is_blind), default=0.0)


class NeedCertificateFile(_FilePart):
    """`need.json` of a suite."""

    format: Literal["mdrive-sumo/need/1"] = "mdrive-sumo/need/1"
    suite_checksum: str
    certificates: tuple[NeedCertificate, ...]

    def of(self, suite: Suite) -> Mapping[str, NeedCertificate]:
        """Return the certificates by scenario id; none if they belong to another version of the suite."""
        return (
            {certificate.scenario: certificate for certificate in self.certificates}
            if self.suite_checksum == suite.checksum()
            else {}
        )


def load_need(suite: Suite) -> Mapping[str, NeedCertificate]:
    """Return the certificates beside a suite or its parts by scenario id; none of a suite that has changed since.

    Raises InputError for an unreadable file.
    """
    files = ((part, read_need(part.folder)) for part in suite.parts or (suite,))
    return {
        name: certificate for part, file in files if file is not None for name, certificate in file.of(part).items()
    }


def read_need(folder: Path) -> NeedCertificateFile | None:
    """Return the certificates in a suite's folder, also of another version of the suite. Raises InputError."""
    path = folder / NEED_FILE
    if not path.is_file():
        return None
    return load_model(path, NeedCertificateFile)


def save_need(folder: Path, content: NeedCertificateFile) -> None:
    """Write `need.json`, one certificate a line."""
    lines = ",\n".join(certificate.model_dump_json() for certificate in content.certificates)
    head = content.model_dump_json(include={"format", "suite_checksum"})
    write_text(folder / NEED_FILE, f'{head[:-1]},"certificates":[\n{lines}\n]}}\n')


def certify_need(
    scenario: Scenario,
    roads: RoadMap,
    reference: EpisodeRecord,
    limits: MotionLimits | None = None,
    *,
    only_first: bool = False,
) -> NeedCertificate:
    """Return the certificate of a scenario.

    reference: the drive of `omniscient`, with the CAVs of the scenario in its first columns. limits: of the CAVs.
    only_first: end with the first conflict that is blind; for a search that asks only whether the certificate holds.
    """
    common = (BuildingEdges(roads), StandingVehicles(reference, False), StandingVehicles(reference, True))
    conflicts: list[NeedConflict] = []
    for column, ego in enumerate(scenario.egos):
        motion = build_route_motion(ego, roads, limits or MotionLimits())
        for zone in ZoneFinder(reference, column, motion).find_zones():
            conflicts.append(_ConflictAnalysis(scenario, roads, reference, *common, column, motion, zone).certify())
            if only_first and conflicts[-1].is_blind:
                return NeedCertificate(scenario=scenario.id, conflicts=tuple(conflicts))
    return NeedCertificate(scenario=scenario.id, conflicts=tuple(conflicts))


@dataclass(frozen=True)
class _ConflictAnalysis:
    """One CAV and one conflict zone."""

    scenario: Scenario
    roads: RoadMap
    reference: EpisodeRecord
    buildings: BuildingEdges
    opaque: StandingVehicles
    high: StandingVehicles
    column: int
    motion: RouteMotion
    zone: ConflictZone

    @property
    def _ego(self) -> Ego:
        return self.scenario.egos[self.column]

    @cached_property
    def _limit_s(self) -> float:
        return compute_time_limit_ticks(self.scenario)[self._ego.id] / TICKS_PER_SECOND

    @cached_property
    def _doom(self) -> DoomTest:
        return self._build_doom_test(over_roofs=False)

    def _build_doom_test(self, over_roofs: bool) -> DoomTest:
        vehicles = self.high if over_roofs else self.opaque
        tables = SightTables(vehicles, self.roads, self.column, self.motion, self.zone)
        return DoomTest(tables, Witnesses(tables, self.scenario, self.buildings))

    @cached_property
    def required_speed(self) -> float:
        """Mean speed [m/s] that the time limit requires, less where the route bends or begins before the zone."""
        motion, zone = self.motion, self.zone
        stations = np.arange(max(zone.enter_m - CURVE_M, 0.0), min(zone.leave_m, motion.line.length), 1.0)
        turn = np.abs(wrap_angles(np.diff(motion.line.yaws_at(stations))))
        turned = np.concatenate(((0.0,), np.cumsum(turn)))
        curvature = float((turned[CURVE_STEPS:] - turned[:-CURVE_STEPS]).max(initial=0.0)) / CURVE_STEPS
        in_curve = math.sqrt(COMFORT / max(curvature, 1e-6))
        fastest = float(np.interp(zone.enter_m, motion.stations, motion.fastest))
        return min(motion.goal_m / self._limit_s, in_curve, REACHED_SHARE * fastest)

    def certify(self) -> NeedConflict:
        """Return what is found about the conflict."""
        least, motion = self.required_speed, self.motion
        free_s = motion.compute_time_from(0.0, motion.start_speed)
        if free_s > self._limit_s:  # nothing is proven of a CAV that cannot be in time
            cautious, blind = SafeCrossing(free_s, self.zone.enter_m, motion.top_speed), False
        else:
            search = CrossingSearch(self._doom, self._limit_s, least)
            cautious = search.find_steady_crossing() or search.find_crossing()
            blind = not self._is_in_time(cautious)
            cautious = CrossingSearch(self._doom, self._limit_s).find_crossing() if blind else cautious
        about = NeedConflict(
            ego=self._ego.id,
            road_user=self.reference.ids[self.zone.road_user],
            x=self.zone.point[0],
            y=self.zone.point[1],
            time_limit_s=self._limit_s,
            required_speed=round(least, 2),
            is_blind=blind,
            is_blind_over_roofs=blind and self._is_blind_over_roofs(),
            cautious_s=round(cautious.arrival_s, 2) if cautious else None,
            cautious_speed=round(cautious.speed, 2) if cautious else None,
            excludes_all=blind and not self._is_in_time(cautious),
            conflict_s=round(self.zone.enter * DT, 2),
        )
        return about.model_copy(update=self._describe_warning()) if blind else about

    def _is_blind_over_roofs(self) -> bool:
        search = CrossingSearch(self._build_doom_test(over_roofs=True), self._limit_s, self.required_speed)
        return not self._is_in_time(search.find_crossing())

    def _is_in_time(self, crossing: SafeCrossing | None) -> bool:
        return crossing is not None and crossing.arrival_s <= self._limit_s

    def _describe_warning(self) -> dict[str, object]:
        warning = ReferenceDrive(self._doom.tables, self._doom.witnesses).find_warning()
        return {
            "stopping_s": warning.stopping_s,
            "own_sight_s": warning.own_sight_s,
            "told_s": warning.told_s,
            "stations": warning.stations,
            "lead_s": warning.lead_s,
        }
