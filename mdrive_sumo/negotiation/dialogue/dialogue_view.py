"""DialogueView: what one member of a conversation knows, in letters and in the measures in which it is told.

MCMs tell all members the same about each other. What holds a member up, what its sensors and the messages of others
show, and the rules at its junction are known to it alone until it says so.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mdrive_sumo.contract import Briefing, Cause, Objects, Observation, Reason
from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.negotiation.conflict_graph import CONFLICT, ConflictGraph, build_conflict_graph
from mdrive_sumo.negotiation.intention import INTERVAL_S
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.negotiation.prompt import find_heading, find_sector
from mdrive_sumo.perception.object_tracker import ObjectTracker
from mdrive_sumo.v2x.messages import Direction, Intention

MAX_TOLD = 4
"""Objects of own sensors, and of others, that a prompt has at most."""
TOLD_WITHIN_M = 20.0
"""Objects farther from the own way are not told of. Chosen."""
TRAFFIC_WITHIN_M = 50.0
"""Of which vehicles `DialogueView.traffic` is the number."""
RULES_WITHIN_M = 60.0
"""A junction or light farther along the route tells nothing yet: 4 s of prediction at 15 m/s."""
LORRY_M = 6.5
"""[m] A longer vehicle is called a lorry."""
STANDING_SPEED = 0.3
"""[m/s]"""
HOLDS: Mapping[Cause, str] = {
    Cause.FOLLOW: "slow {other}",
    Cause.BLOCKED: "{other}",
    Cause.YIELD: "crossing {other}",
    Cause.AVOID: "crossing {other}",
    Cause.ONCOMING: "oncoming {other}",
    Cause.OBSTACLE: "obstacle",
    Cause.HAZARD: "{other}",
    Cause.PEDESTRIAN: "pedestrian",
    Cause.STOP_SIGN: "stop sign",
    Cause.LIGHT: "red light",
    Cause.NO_WAY: "{other}",
}
"""Names of what limits a plan; causes that agreements make, and those of a free road, hold nothing up."""


@dataclass(frozen=True, slots=True)
class MemberView:
    """A member as another one, or itself, knows it from its MCM."""

    letter: str
    direction: Direction
    speed: float
    """[m/s]"""
    action: Intention
    """What it does now."""
    zone_s: tuple[float, float] | None = None
    """When it enters and leaves the areas that it shares with its opponents on a free road [s from now]; None: not
    within the prediction."""
    distance_m: float = 0.0
    sector: str = ""
    """Where it is, seen from the viewer; "" for the viewer itself."""
    heading: str = ""
    in_conflict: bool = False
    """With the viewer."""
    follows: str = ""
    """Letter of the member ahead on its way."""
    sigma_m: float = 0.0
    """Standard deviation of its position [m]."""


@dataclass(frozen=True, slots=True)
class ToldObject:
    """A road user that is no member."""

    source: str
    """"": own sensor; a letter: that member; "other": another station."""
    name: str
    distance_m: float
    sector: str
    speed: float
    sigma_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Hold:
    """What holds the viewer up on its way."""

    name: str
    distance_m: float | None = None
    seconds: float | None = None
    """Until it ends [s], if that is known."""


@dataclass(frozen=True, slots=True)
class DialogueView:
    """What one member knows."""

    me: str
    """Letter of the viewer."""
    members: tuple[MemberView, ...]
    """All of the group, by letter, the viewer too."""
    yields: tuple[tuple[str, str], ...] = ()
    """(member that gives way, the one that goes first) by the rules of the road, as far as the viewer knows."""
    light: str = ""
    """State of the next light on its way: "red", "yellow", "green", or "" without one."""
    hold: Hold | None = None
    objects: tuple[ToldObject, ...] = ()
    """Nearest to the viewer's way first, own ones before those of others."""
    traffic: int = 0
    """Vehicles around it that are no members."""

    @property
    def letters(self) -> str:
        """Letters of all members."""
        return "".join(member.letter for member in self.members)

    def get_member(self, letter: str) -> MemberView:
        """Return a member."""
        return next(member for member in self.members if member.letter == letter)


@dataclass(frozen=True, slots=True)
class OwnKnowledge:
    """What a CAV knows beside the MCMs of members. Ids are those of its tracker."""

    objects: Objects
    """Tracked, stations that are members may be among them."""
    reason: Reason
    """What limits its plan."""
    sources: Mapping[str, str] = field(default_factory=dict[str, str])
    """Station that told of an object; "" or missing: own sensor."""
    sigmas: Mapping[str, float] = field(default_factory=dict[str, float])
    """[m]"""
    junction: JunctionKind | None = None
    """The next one on its route, if it is near."""
    light: str = ""
    """Letter of the next light, as in `Observation.signals`."""

    @classmethod
    def gather(
        cls, briefing: Briefing, seen: Observation, s: float, reason: Reason, tracker: ObjectTracker
    ) -> "OwnKnowledge":
        """Return what a CAV knows in a tick. s: arc length [m] of its box centre along its route; tracker: updated."""
        ahead: Iterator[JunctionKind] = (
            one.kind for one in briefing.junctions if one.exit_s > s and one.entry_s < s + RULES_WITHIN_M
        )
        lights = [one.id for one in briefing.traffic_lights if s - 1.0 < one.s < s + RULES_WITHIN_M]
        return cls(
            objects=tracker.objects,
            reason=reason,
            sources=tracker.sources,
            sigmas=tracker.position_sigmas,
            junction=next(ahead, None),
            light=seen.signals.get(lights[0], "") if lights else "",
        )


def build_dialogue_view(
    me: str,
    members: Sequence[NegotiationMember],
    letter_by_station: Mapping[str, str],
    leaders: Collection[tuple[str, str]],
    known: OwnKnowledge,
) -> DialogueView:
    """Return what a station knows of its group. leaders: (leader, follower) pairs of stations."""
    members = [member for member in members if member.id in letter_by_station]
    by_id = {member.id: member for member in members}
    viewer, letters = by_id[me], letter_by_station
    graph = build_conflict_graph(members)
    zones, opponents = find_zones(members, graph), graph.find_opponents(me)
    follows = {letters[second]: letters[first] for first, second in sorted(leaders) if {first, second} <= set(by_id)}
    views = [
        MemberView(
            letter=letters[one.id],
            direction=one.direction,
            speed=one.speed,
            action=one.intention,
            zone_s=zones[one.id],
            distance_m=float(portable.hypot(one.x - viewer.x, one.y - viewer.y)),
            sector="" if one is viewer else find_sector(viewer, one.x, one.y),
            heading="" if one is viewer else find_heading(viewer, one.yaw),
            in_conflict=one.id in opponents,
            follows=follows.get(letters[one.id], ""),
            sigma_m=one.position_sigma,
        )
        for one in members
    ]
    return DialogueView(
        me=letters[me],
        members=tuple(sorted(views, key=lambda view: view.letter)),
        yields=_find_yields(viewer, [one for one in members if one.id in opponents], letters, known.junction),
        light={"r": "red", "y": "yellow", "g": "green", "G": "green"}.get(known.light, ""),
        hold=_describe_hold(known, letters),
        objects=_choose_objects(viewer, letters, known),
        traffic=_count_traffic(viewer, letters, known.objects),
    )


def find_zones(members: Sequence[NegotiationMember], graph: ConflictGraph) -> dict[str, tuple[float, float] | None]:
    """Return when each member is in the areas that it shares with its opponents [s from now], on a free road.

    graph: of the members. The first time is `ConflictGraph.get_entry_time`, by which `passing` orders them.
    """
    points = np.array([member.desired for member in members])
    x, y = points[..., 0], points[..., 1]
    gaps = portable.hypot(x[:, None, :, None] - x[None, :, None], y[:, None, :, None] - y[None, :, None])
    is_shared = gaps.min(-1) < CONFLICT.min_distance_m
    zones: dict[str, tuple[float, float] | None] = {}
    for row, member in enumerate(members):
        inside = np.flatnonzero(is_shared[row, graph.in_conflict[row]].any(0))
        zones[member.id] = (_step_time(inside[0]), _step_time(inside[-1])) if len(inside) else None
    return zones


def _step_time(step: int) -> float:
    return round((int(step) + 1) * INTERVAL_S, 1)


_GIVE_WAY: frozenset[JunctionKind] = frozenset(("yield", "stop"))


def _find_yields(
    me: NegotiationMember,
    opponents: Sequence[NegotiationMember],
    letters: Mapping[str, str],
    junction: JunctionKind | None,
) -> tuple[tuple[str, str], ...]:
    """Return which of the viewer and each opponent gives way by the rules that the viewer's approach shows."""
    pairs: list[tuple[str, str]] = []
    for other in opponents:
        gives_way = _gives_way(me, other, junction)
        if gives_way is not None:
            first, second = (me.id, other.id) if gives_way else (other.id, me.id)
            pairs.append((letters[first], letters[second]))
    return tuple(sorted(pairs))


def _gives_way(me: NegotiationMember, other: NegotiationMember, junction: JunctionKind | None) -> bool | None:
    """Return whether the viewer gives way to another member; None if no rule that it knows says so."""
    heading = find_heading(me, other.yaw)
    if heading == "towards":
        turns_left = (me.direction == Direction.LEFT, other.direction == Direction.LEFT)
        return turns_left[0] if turns_left[0] != turns_left[1] else None
    if heading == "same direction":
        changes = (Direction.CHANGE_LEFT, Direction.CHANGE_RIGHT)
        moves_over = (me.direction in changes, other.direction in changes)
        return moves_over[0] if moves_over[0] != moves_over[1] else None
    if junction in _GIVE_WAY or junction == "priority-road":
        return junction in _GIVE_WAY
    if junction in ("right-before-left", "left-before-right"):
        return (heading == "from right to left") == (junction == "right-before-left")
    return heading == "from left to right" if junction == "roundabout" else None


def _describe_hold(known: OwnKnowledge, letters: Mapping[str, str]) -> Hold | None:
    """Return what holds the viewer up, unless it is a member: of those the MCMs tell."""
    reason = known.reason
    pattern = HOLDS.get(reason.cause)
    if pattern is None or (reason.others and reason.others[0] in letters):
        return None
    other = "traffic"
    if reason.others and reason.others[0] in known.objects.ids:
        other = _name_object(known.objects, known.objects.ids.index(reason.others[0]))
    return Hold(pattern.format(other=other), reason.distance_m, reason.seconds)


def _name_object(objects: Objects, row: int) -> str:
    kind = int(objects.kind[row])
    if kind == Kind.VEHICLE:
        return "lorry" if objects.length[row] > LORRY_M else "car"
    return {Kind.PEDESTRIAN: "pedestrian", Kind.CYCLIST: "cyclist"}.get(Kind(kind), "obstacle")


def _choose_objects(
    viewer: NegotiationMember, letters: Mapping[str, str], known: OwnKnowledge
) -> tuple[ToldObject, ...]:
    """Return the objects nearest to the viewer's way, which are no members."""
    objects, told = known.objects, list[tuple[bool, float, ToldObject]]()
    way: Float = np.vstack(((viewer.x, viewer.y), viewer.desired))
    for row, name in enumerate(objects.ids):
        x, y = float(objects.x[row]), float(objects.y[row])
        gap = float(portable.hypot(way[:, 0] - x, way[:, 1] - y).min())
        if name in letters or gap > TOLD_WITHIN_M:
            continue
        station = known.sources.get(name, "")
        one = ToldObject(
            source=letters.get(station, "other") if station else "",
            name=_name_object(objects, row),
            distance_m=float(portable.hypot(x - viewer.x, y - viewer.y)),
            sector=find_sector(viewer, x, y),
            speed=float(objects.speed[row]),
            sigma_m=known.sigmas.get(name, 0.0) if station else 0.0,
        )
        told.append((bool(station), gap, one))
    told.sort(key=lambda entry: entry[:2])
    return tuple(one for from_others in (False, True) for one in [e[2] for e in told if e[0] == from_others][:MAX_TOLD])


def _count_traffic(viewer: NegotiationMember, letters: Mapping[str, str], objects: Objects) -> int:
    near = portable.hypot(objects.x - viewer.x, objects.y - viewer.y) <= TRAFFIC_WITHIN_M
    is_moving = (objects.kind == Kind.VEHICLE) & (np.abs(objects.speed) > STANDING_SPEED) & near
    return sum(name not in letters for name, yes in zip(objects.ids, is_moving.tolist(), strict=True) if yes)
