"""When a driver without messages arrives at the earliest that is safe against all that may be hidden on its route."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks
from mdrive_sumo.sensing.visibility import BuildingEdges
from mdrive_sumo.study.need.conflict_zone import ConflictZone, ZoneFinder
from mdrive_sumo.study.need.doom import DoomTest
from mdrive_sumo.study.need.message_lead import ReferenceDrive, Witnesses
from mdrive_sumo.study.need.motion import MotionLimits, RouteMotion, build_route_motion
from mdrive_sumo.study.need.occluders import StandingVehicles
from mdrive_sumo.study.need.route_search import SafeArrival, WayPoint, ZoneStates, find_free_way, find_safe_arrival
from mdrive_sumo.study.need.sight_tables import SightTables
from mdrive_sumo.study.need.speed_grid import SpeedGrid


@dataclass(frozen=True)
class NeedContext:
    """What the analyses of all CAVs of a scenario share."""

    scenario: Scenario
    roads: RoadMap
    reference: EpisodeRecord
    limits: MotionLimits

    @cached_property
    def buildings(self) -> BuildingEdges:
        """The edges of all buildings."""
        return BuildingEdges(self.roads)

    @cached_property
    def standing(self) -> Mapping[bool, StandingVehicles]:
        """All that stands and hides something: in the plane (False), and from a LiDAR on the roof (True)."""
        return {over_roofs: StandingVehicles(self.reference, over_roofs) for over_roofs in (False, True)}

    @cached_property
    def _unyielding(self) -> frozenset[str]:
        """Ids of the scripted actors that avoid no collision."""
        return frozenset(actor.id for actor in self.scenario.actors if not actor.avoid_collision)

    def build_doom_test(self, tables: SightTables, witnesses: Witnesses | None) -> DoomTest:
        """Return the test of a conflict; see `DoomTest` for the witnesses."""
        return DoomTest(tables, witnesses, self.reference.ids[tables.zone.road_user] in self._unyielding)


@dataclass(frozen=True)
class RouteAnalysis:
    """One CAV, its route, and its conflict zones."""

    context: NeedContext
    column: int

    @property
    def ego(self) -> Ego:
        """The CAV."""
        return self.context.scenario.egos[self.column]

    @cached_property
    def limit_s(self) -> float:
        """Its time limit [s]."""
        return compute_time_limit_ticks(self.context.scenario)[self.ego.id] / TICKS_PER_SECOND

    @cached_property
    def motion(self) -> RouteMotion:
        """All ways to drive the route."""
        return build_route_motion(self.ego, self.context.roads, self.context.limits)

    @cached_property
    def zones(self) -> tuple[ConflictZone, ...]:
        """The first zone with each road user whose drive crosses the route."""
        return tuple(ZoneFinder(self.context.reference, self.column, self.motion).find_zones())

    @cached_property
    def grid(self) -> SpeedGrid:
        """The stations and speeds of all ways to drive the route."""
        return SpeedGrid(self.motion)

    @cached_property
    def free_way(self) -> tuple[WayPoint, ...]:
        """The fastest way on a free road, from the goal back to the start."""
        return find_free_way(self.grid)

    @property
    def free_s(self) -> float:
        """Least arrival time [s] on a free road."""
        return self.free_way[0].time_s

    def find_safe_arrival(self, over_roofs: bool) -> SafeArrival:
        """Return the least arrival time of a driver that is safe against all that may be hidden.

        In the world in which it is in time, none of the road users is there that the bound rests on, so none of them
        hides another one.
        """
        standing = self.context.standing[over_roofs]
        arrival = self._search(self.zones, standing)
        if not _hides_any(standing, arrival.road_users):
            return arrival
        zones = [zone for zone in self.zones if zone.road_user in arrival.road_users]
        return self._search(zones, StandingVehicles(standing.record, over_roofs, arrival.road_users))

    def _search(self, zones: Collection[ConflictZone], standing: StandingVehicles) -> SafeArrival:
        return find_safe_arrival(self.grid, [self.build_states(zone, standing) for zone in zones])

    def build_states(self, zone: ConflictZone, standing: StandingVehicles) -> ZoneStates:
        """Return the states of the grid before and in a zone, and which of them are doomed behind what stands."""
        key = zone.road_user, standing.over_roofs, standing.absent
        if key not in self._states:
            tables = self.build_tables(zone, standing)
            reference = ReferenceDrive(tables, self.build_witnesses(tables))
            self._states[key] = ZoneStates(self.grid, self.context.build_doom_test(tables, None), reference)
        return self._states[key]

    @cached_property
    def _states(self) -> dict[tuple[int, bool, frozenset[int]], ZoneStates]:
        return {}

    def build_tables(self, zone: ConflictZone, standing: StandingVehicles) -> SightTables:
        """Return what is hidden in a conflict behind what stands."""
        key = zone.road_user, standing.over_roofs, standing.absent
        if key not in self._tables:
            self._tables[key] = SightTables(standing, self.context.roads, self.column, self.motion, zone)
        return self._tables[key]

    def build_witnesses(self, tables: SightTables) -> Witnesses:
        """Return the stations that could tell of the road user of a conflict."""
        road_user = tables.zone.road_user
        if road_user not in self._witnesses:
            self._witnesses[road_user] = Witnesses(tables, self.context.scenario, self.context.buildings)
        return self._witnesses[road_user]

    @cached_property
    def _witnesses(self) -> dict[int, Witnesses]:
        return {}

    @cached_property
    def _tables(self) -> dict[tuple[int, bool, frozenset[int]], SightTables]:
        return {}


def _hides_any(standing: StandingVehicles, users: frozenset[int]) -> bool:
    stands = standing.standing.any(axis=0)
    return any(column in users for column in standing.columns[stands].tolist())


def find_cautious_arrival(
    scenario: Scenario, roads: RoadMap, reference: EpisodeRecord, limits: MotionLimits | None = None
) -> Mapping[str, float | None]:
    """Return when a driver of each CAV arrives at the earliest [s] that is safe against all that may be hidden.

    By CAV id; None: no drive is safe, however long it takes. A certificate proves `all` if a time limit is below it.
    The result does not depend on the time limits of the scenario. reference: the drive of `omniscient`, with the CAVs
    of the scenario in its first columns. limits: of the CAVs.
    """
    context = NeedContext(scenario, roads, reference, limits or MotionLimits())
    arrivals = {
        ego.id: RouteAnalysis(context, column).find_safe_arrival(False).time_s
        for column, ego in enumerate(scenario.egos)
    }
    return {name: time_s if math.isfinite(time_s) else None for name, time_s in arrivals.items()}
