"""Certificates of need: what no CAV without messages can do, whatever its planner.

Take a CAV, a road user whose drive crosses its route, and the worlds in which the road user makes its drive of the
reference earlier or later by whole ticks, or never comes. A driver without messages does the same in all of them until
it sees the road user. What a certificate proves has two levels (`Proof`):

`conflict`: a driver of the CAV that is no slower than `required_speed`, from where a CAV of that speed can last stop
until the zone of that conflict is left, collides with the road user in one of its worlds.

`all`: take all road users that the certificate of a route names (`NeedRoute.road_users`), and the worlds in which at
most one of them comes, for each of its starts. A driver of the CAV that arrives within the time limit where none of
them comes collides in one of the others, whatever its speeds are: it may stand, creep, brake and accelerate wherever
it likes within the limits of car and road.

Proof. Both search the ways through a grid of stations and speeds from which the states that are *doomed* (`need.doom`)
are taken out: for some start of the road user, no place where the CAV can have been at an earlier tick sees it, so the
driver has done the same as in the world without it; and after the state neither full braking nor full acceleration, of
the CAV or of a vehicle that reacts as soon as it can see the CAV, keeps both apart. Every drive has a way through the
grid, with times and speeds that are no worse for it. `conflict` (`need.crossing_search`): no way before and in the zone
that keeps the required speed is in time. `all` (`need.route_search`): the way of least time through the whole route,
past the doomed states of all conflicts at once, is later than the limit. A drive that is in time where none of them
comes therefore has a doomed state of some road user, and collides in the world in which that one comes at that start:
no other comes there that the driver could have seen instead, and none of those named counts as an occluder.

A message can prevent it: for `conflict` another station has seen the road user 0.2 s before that state or earlier,
whenever it is. For `all` each road user that is named is a CAV, or another CAV or a road-side unit sees it in the
reference drive while the CAV can still stop.

Assumptions: the CAV stays within 0.25 m of its route and the speed limits, looks from its box centre, and sees
whatever is not hidden, to 1000 m and at any share. Only buildings and what stands still for whole half seconds hide
anything: in the plane, as for the objects sensor, cars and high props do; `over_roofs` asks the same of the LiDAR on
the roof. Vehicles brake with 9 m/s2 once they can see the CAV; pedestrians, cyclists, and scripted vehicles that avoid
no collision keep their course. A road user that exists in the first tick waits at its start if it leaves later.

What it does not say: that a driver fails in the scenario as written, whose start it may meet by luck; anything about
drivers that leave their route, mount a LiDAR elsewhere, or, for `conflict`, spend their spare time before this zone.
Bounds err on the side of not certifying, except where time is sampled: boxes are compared at recorded ticks, and a
witness's line of sight at both ends of half a second. Other traffic moves as in the reference in all worlds.

For `validate` and `generate --hard`: `certify_need` takes the scenario with its time limits and the reference drive.
Other time limits make other certificates; `find_cautious_arrival` does not depend on them.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from mdrive_sumo.core.geometry import wrap_angles
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.study.certificate_file import CertificateFile, CertificatePart, ScenarioCertificate
from mdrive_sumo.study.need.cautious_arrival import NeedContext, RouteAnalysis, find_cautious_arrival
from mdrive_sumo.study.need.conflict_zone import ConflictZone
from mdrive_sumo.study.need.crossing_search import CrossingSearch
from mdrive_sumo.study.need.message_lead import ReferenceDrive
from mdrive_sumo.study.need.motion import STEP_M, MotionLimits

__all__ = [
    "NEED_FILE",
    "NeedCertificate",
    "NeedCertificateFile",
    "NeedConflict",
    "NeedRoute",
    "Proof",
    "certify_need",
    "find_cautious_arrival",
]

NEED_FILE = "need.json"
FORMAT_1 = "mdrive-sumo/need/1"
COMFORT = 2.0
"""Lateral acceleration [m/s2] up to which a curve does not lower the required speed."""
REACHED_SHARE = 0.8
"""The required speed is at most this share of the greatest speed that the CAV can have at the zone."""
CURVE_M = 10.0
"""Length of route before the zone on which a curve counts."""
CURVE_STEPS = 5
"""Metres over which a curvature is the mean."""


class Proof(StrEnum):
    """What is proven of drivers without messages; see the module."""

    CONFLICT = "conflict"
    """At the speeds that the time limit requires, one hidden conflict cannot be met."""
    ALL = "all"
    """No speed profile is both safe against every road user that may be hidden, and in time."""


class NeedConflict(CertificatePart):
    """A CAV and another road user whose drives cross, where something is proven."""

    ego: str
    road_user: str
    x: float
    """Of the CAV's centre where the conflict zone begins [m]."""
    y: float
    required_speed: float
    """Mean speed [m/s] that the time limit requires of the CAV, less in a curve."""
    proves: Proof
    """`conflict`: the conflict cannot be met at the required speed. `all`: the proof of the CAV's whole route rests on
    this conflict and those with the same value."""
    proves_over_roofs: Proof | None
    """The same of a LiDAR on the roof, from which only buildings, lorries and buses hide anything; or null."""
    conflict_s: float
    """When the road user enters the zone in the reference drive."""
    stopping_s: float | None = None
    """Last tick of the reference drive at which the CAV could stop before the zone."""
    own_sight_s: float | None = None
    """First tick of the reference drive at which a sensor of the CAV sees the road user; null: not before the zone."""
    told_s: float | None = None
    """First tick of the reference drive at which a station could tell of the road user."""
    stations: tuple[str, ...] = ()
    """Those that could before `stopping_s`: the road user itself if it is a CAV, other CAVs and road-side units."""
    lead_s: float = 0.0
    """How many seconds earlier than its own sensors a message tells the CAV of the road user in the reference drive."""


class NeedRoute(CertificatePart):
    """What a CAV without messages can do on its whole route."""

    ego: str
    time_limit_s: float
    free_s: float
    """Least arrival time [s] on a free road."""
    cautious_s: float | None
    """Least arrival time [s] of a driver that is safe against every road user that may be hidden; a lower bound. Null
    if no driver is, however long it takes."""
    cautious_over_roofs_s: float | None
    """The same with a LiDAR on the roof, from which only buildings, lorries and buses hide anything."""
    road_users: tuple[str, ...]
    """Those on which `cautious_s` rests."""

    @property
    def proves(self) -> Proof | None:
        """`all`, if no safe driver is in time."""
        return self._find_proof(self.cautious_s)

    @property
    def proves_over_roofs(self) -> Proof | None:
        """The same with a LiDAR on the roof."""
        return self._find_proof(self.cautious_over_roofs_s)

    def _find_proof(self, cautious_s: float | None) -> Proof | None:
        can_arrive = self.free_s <= self.time_limit_s  # nothing is proven of a CAV that cannot be in time
        return Proof.ALL if can_arrive and (cautious_s is None or cautious_s > self.time_limit_s) else None


class NeedCertificate(ScenarioCertificate):
    """What is proven of a scenario."""

    routes: tuple[NeedRoute, ...] = ()
    """All CAVs, in the order of the scenario."""
    conflicts: tuple[NeedConflict, ...]
    """Those in which something is proven."""

    @property
    def proves(self) -> Proof | None:
        """The most that is proven of one of the CAVs, or None."""
        return _find_strongest(part.proves for part in (*self.routes, *self.conflicts))

    @property
    def proves_over_roofs(self) -> Proof | None:
        """The same with a LiDAR on the roof."""
        return _find_strongest(part.proves_over_roofs for part in (*self.routes, *self.conflicts))

    @property
    def holds(self) -> bool:
        """Whether anything is proven."""
        return self.proves is not None

    @property
    def lead_s(self) -> float:
        """The most seconds that a message gains in a conflict; 0 without one."""
        return max((conflict.lead_s for conflict in self.conflicts), default=0.0)


def _find_strongest(proofs: Iterable[Proof | None]) -> Proof | None:
    found = set(proofs)
    return next((proof for proof in (Proof.ALL, Proof.CONFLICT) if proof in found), None)


class NeedCertificateFile(CertificateFile[NeedCertificate]):
    """`need.json` of a suite."""

    NAME = NEED_FILE
    format: Literal["mdrive-sumo/need/2"] = "mdrive-sumo/need/2"

    @model_validator(mode="before")
    @classmethod
    def _read_format_1(cls, data: Any) -> Any:
        """Keep the conflicts of format 1 in which something was proven; it says nothing of whole routes."""
        if not isinstance(data, dict) or data.get("format") != FORMAT_1:
            return data
        try:
            kept = [
                {"scenario": one["scenario"], "conflicts": _convert_conflicts(one["conflicts"])}
                for one in data["certificates"]
            ]
        except (KeyError, TypeError, AttributeError):  # of neither format: the field `format` is what is reported
            return data
        return {"suite_checksum": data.get("suite_checksum"), "certificates": kept}


def _convert_conflicts(conflicts: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the conflicts of format 1 that are blind, as those of format 2."""
    return [
        {name: conflict[name] for name in NeedConflict.model_fields if name in conflict}
        | {"proves": "conflict", "proves_over_roofs": "conflict" if conflict["is_blind_over_roofs"] else None}
        for conflict in conflicts
        if conflict["is_blind"]
    ]


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
    only_first: end with the first conflict that is proven, without a word on whole routes; for a search that asks only
    whether the certificate holds.
    """
    context = NeedContext(scenario, roads, reference, limits or MotionLimits())
    routes: list[NeedRoute] = []
    conflicts: list[NeedConflict] = []
    for column in range(len(scenario.egos)):
        analysis = RouteAnalysis(context, column)
        found = (_ConflictAnalysis(analysis, zone) for zone in analysis.zones)
        if only_first:
            first = next((conflict for conflict in found if conflict.is_blind(over_roofs=False)), None)
            if first is not None:
                return NeedCertificate(scenario=scenario.id, conflicts=(first.describe(Proof.CONFLICT, None),))
            continue
        route, users, users_over_roofs = _certify_route(analysis)
        routes.append(route)
        conflicts += [
            certified
            for conflict in found
            if (
                certified := conflict.certify(
                    route.proves if conflict.zone.road_user in users else None,
                    route.proves_over_roofs if conflict.zone.road_user in users_over_roofs else None,
                )
            )
            is not None
        ]
    return NeedCertificate(scenario=scenario.id, routes=tuple(routes), conflicts=tuple(conflicts))


def _certify_route(analysis: RouteAnalysis) -> tuple[NeedRoute, frozenset[int], frozenset[int]]:
    """Return what is found about a CAV's route, and the columns of the road users it rests on, also over roofs."""
    in_plane = analysis.find_safe_arrival(over_roofs=False)
    # From a roof a CAV sees no less, so nothing is proven there that is not proven in the plane.
    over_roofs = analysis.find_safe_arrival(over_roofs=True) if in_plane.time_s > analysis.limit_s else in_plane
    route = NeedRoute(
        ego=analysis.ego.id,
        time_limit_s=analysis.limit_s,
        free_s=round(analysis.free_s, 2),
        cautious_s=_round_bound(in_plane.time_s),
        cautious_over_roofs_s=_round_bound(over_roofs.time_s),
        road_users=tuple(analysis.context.reference.ids[user] for user in sorted(in_plane.road_users)),
    )
    return route, in_plane.road_users, over_roofs.road_users


def _round_bound(time_s: float) -> float | None:
    return math.floor(time_s * 100.0) / 100.0 if math.isfinite(time_s) else None


@dataclass(frozen=True)
class _ConflictAnalysis:
    """One CAV and one conflict zone."""

    analysis: RouteAnalysis
    zone: ConflictZone

    @cached_property
    def required_speed(self) -> float:
        """Mean speed [m/s] that the time limit requires, less where the route bends or begins before the zone."""
        motion, zone = self.analysis.motion, self.zone
        stations = np.arange(max(zone.enter_m - CURVE_M, 0.0), min(zone.leave_m, motion.line.length), 1.0)
        turn = np.abs(wrap_angles(np.diff(motion.line.yaws_at(stations))))
        turned = np.concatenate(((0.0,), np.cumsum(turn)))
        curvature = float((turned[CURVE_STEPS:] - turned[:-CURVE_STEPS]).max(initial=0.0)) / CURVE_STEPS
        in_curve = math.sqrt(COMFORT / max(curvature, 1e-6))
        fastest = float(np.interp(zone.enter_m, motion.stations, motion.fastest))
        return min(motion.goal_m / self.analysis.limit_s, in_curve, REACHED_SHARE * fastest)

    def is_blind(self, over_roofs: bool) -> bool:
        """Return whether no drive that keeps the required speed in the approach avoids all doomed states in time."""
        limit_s, motion = self.analysis.limit_s, self.analysis.motion
        if motion.compute_time_from(0.0, motion.start_speed) > limit_s:  # of a CAV that cannot be in time at all
            return False
        tables = self.analysis.build_tables(self.zone, self.analysis.context.standing[over_roofs])
        doom = self.analysis.context.build_doom_test(tables, self.analysis.build_witnesses(tables))
        search = CrossingSearch(doom, limit_s, self.required_speed)
        return not self._is_crossed_freely(search, over_roofs) and search.find_crossing() > limit_s

    def _is_crossed_freely(self, search: CrossingSearch, over_roofs: bool) -> bool:
        """Return whether the fastest way is a crossing; a cheap test that spares the search where nothing is hidden."""
        analysis = self.analysis
        states = analysis.build_states(self.zone, analysis.context.standing[over_roofs])
        way = [point for point in analysis.free_way if search.last_entry_m < point.step * STEP_M <= self.zone.leave_m]
        is_steady = all(analysis.grid.bounds[point.cell] >= self.required_speed for point in way)
        return is_steady and analysis.free_s <= analysis.limit_s and not states.meets(analysis.free_way)

    def certify(self, by_route: Proof | None, by_route_over_roofs: Proof | None) -> NeedConflict | None:
        """Return what is proven of the conflict, or None. by_route: what the proof of the whole route adds."""
        is_blind = by_route_over_roofs is None and self.is_blind(over_roofs=False)
        over_roofs = by_route_over_roofs or (Proof.CONFLICT if is_blind and self.is_blind(over_roofs=True) else None)
        proves = by_route or (Proof.CONFLICT if is_blind else None)
        return self.describe(proves, over_roofs) if proves else None

    def describe(self, proves: Proof, over_roofs: Proof | None) -> NeedConflict:
        """Return the conflict with what is proven of it."""
        context = self.analysis.context
        tables = self.analysis.build_tables(self.zone, context.standing[False])
        warning = ReferenceDrive(tables, self.analysis.build_witnesses(tables)).find_warning()
        return NeedConflict(
            ego=self.analysis.ego.id,
            road_user=context.reference.ids[self.zone.road_user],
            x=self.zone.point[0],
            y=self.zone.point[1],
            required_speed=round(self.required_speed, 2),
            proves=proves,
            proves_over_roofs=over_roofs,
            conflict_s=round(self.zone.enter * DT, 2),
            stopping_s=warning.stopping_s,
            own_sight_s=warning.own_sight_s,
            told_s=warning.told_s,
            stations=warning.stations,
            lead_s=warning.lead_s,
        )
