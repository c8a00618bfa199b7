"""Rules that a proposal must satisfy before it is placed on a map; each rule is one function that yields sentences.

Rules of MDrive's generator (protocol 14.1, "Spec validation" and "Conflict rules"), and those of its category table.
"""

from collections.abc import Callable, Iterator
from itertools import combinations

from mdrive_sumo.generate.category_requirements import Category, find_requirements
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.worlds.encounters.proposed_actor import ActorKind

MAX_ACTORS = 8
ON_FOOT: tuple[ActorKind, ...] = ("walker", "cyclist")
CONFLICT_RELATIONS = frozenset(
    (
        "opposite_approach_of",
        "perpendicular_right_of",
        "perpendicular_left_of",
        "left_lane_of",
        "right_lane_of",
        "merges_into_lane_of",
        "same_lane_as",
    )
)
"""Relations that can lead to a conflict."""
LANE_RELATIONS = frozenset(("left_lane_of", "right_lane_of", "merges_into_lane_of", "same_lane_as"))
CONTRADICTIONS = (
    ("same_approach_as", "opposite_approach_of"),
    ("same_approach_as", "perpendicular_right_of"),
    ("same_approach_as", "perpendicular_left_of"),
    ("opposite_approach_of", "perpendicular_right_of"),
    ("opposite_approach_of", "perpendicular_left_of"),
    ("perpendicular_right_of", "perpendicular_left_of"),
    ("left_lane_of", "right_lane_of"),
    ("left_lane_of", "same_lane_as"),
    ("right_lane_of", "same_lane_as"),
)
"""Pairs of relations that cannot hold between the same two vehicles, in the same order."""
MIRRORED = {
    "perpendicular_right_of": "perpendicular_left_of",
    "perpendicular_left_of": "perpendicular_right_of",
    "left_lane_of": "right_lane_of",
    "right_lane_of": "left_lane_of",
}
"""`a` relation `b` is the same as `b` MIRRORED[relation] `a`; relations that are not named are symmetric."""


def find_rule_violations(proposal: Proposal) -> tuple[str, ...]:
    """Return all rule violations of a proposal, one sentence each; empty if it is valid."""
    return tuple(problem for rule in RULES for problem in rule(proposal))


def _check_topology(proposal: Proposal) -> Iterator[str]:
    wanted = find_requirements(proposal.category).road.topologies
    if proposal.topology not in wanted:
        yield f"topology: expected {' or '.join(wanted)} for {proposal.category}, found {proposal.topology}"


def _check_needs(proposal: Proposal) -> Iterator[str]:
    if proposal.category is Category.PRE_CRASH:
        return  # the typology decides, see pre_crash_typologies.py
    needs = find_requirements(proposal.category).road
    for name in ("oncoming", "multi_lane", "on_ramp", "merge"):
        wanted, found = getattr(needs, name), getattr(proposal, f"needs_{name}")
        if wanted != found:
            yield f"needs_{name}: expected {str(wanted).lower()} for {proposal.category}, found {str(found).lower()}"


def _check_ego_count(proposal: Proposal) -> Iterator[str]:
    least, most = find_requirements(proposal.category).cav_range
    found = len(proposal.ego_vehicles)
    if not least <= found <= most:
        yield f"ego_vehicles: expected {least} to {most} for {proposal.category}, found {found}"


def _check_ego_ids(proposal: Proposal) -> Iterator[str]:
    found = [ego.vehicle_id for ego in proposal.ego_vehicles]
    wanted = [f"Vehicle {n}" for n in range(1, len(found) + 1)]
    if found != wanted:
        yield f"ego_vehicles: expected the ids {', '.join(wanted)} in this order, found {', '.join(found)}"


def _check_actor_count(proposal: Proposal) -> Iterator[str]:
    found = sum(actor.quantity for actor in proposal.actors)
    if found > MAX_ACTORS:
        yield f"actors: expected at most {MAX_ACTORS}, quantities counted, found {found}"


def _check_actor_ids(proposal: Proposal) -> Iterator[str]:
    ids = [actor.actor_id for actor in proposal.actors]
    for name in sorted({name for name in ids if ids.count(name) > 1}):
        yield f"actors: expected every actor_id once, found {name} {ids.count(name)} times"


def _check_known_ids(proposal: Proposal) -> Iterator[str]:
    known = {ego.vehicle_id for ego in proposal.ego_vehicles}
    for number, constraint in enumerate(proposal.vehicle_constraints):
        for end in (constraint.a, constraint.b):
            if end not in known:
                yield f"vehicle_constraints.{number}: expected one of the ego vehicles, found {end}"
    for actor in proposal.actors:
        if actor.affects_vehicle not in known:
            yield f"actor {actor.actor_id}: affects_vehicle: expected one of the ego vehicles, found " + (
                actor.affects_vehicle
            )


def _check_no_self_relation(proposal: Proposal) -> Iterator[str]:
    for number, constraint in enumerate(proposal.vehicle_constraints):
        if constraint.a == constraint.b:
            yield f"vehicle_constraints.{number}: expected two vehicles, found {constraint.a} twice"


def _check_contradictions(proposal: Proposal) -> Iterator[str]:
    said: dict[tuple[str, str], set[str]] = {}
    for constraint in proposal.vehicle_constraints:
        said.setdefault((constraint.a, constraint.b), set()).add(constraint.type)
        mirrored = MIRRORED.get(constraint.type, constraint.type)
        said.setdefault((constraint.b, constraint.a), set()).add(mirrored)
    for (a, b), types in sorted(said.items()):
        if a > b:
            continue
        for one, other in combinations(sorted(types), 2):
            if (one, other) in CONTRADICTIONS or (other, one) in CONTRADICTIONS:
                yield f"vehicle_constraints: {a} cannot be both {one} and {other} {b}"


def _check_crossing_actors(proposal: Proposal) -> Iterator[str]:
    for actor in proposal.actors:
        if actor.motion == "cross_perpendicular" and actor.kind not in ON_FOOT:
            yield f"actor {actor.actor_id}: expected a walker or cyclist to cross_perpendicular, found {actor.kind}"


def _check_static_actors(proposal: Proposal) -> Iterator[str]:
    for actor in proposal.actors:
        if actor.kind in ("static_prop", "parked_vehicle") and actor.motion != "static":
            yield f"actor {actor.actor_id}: expected a {actor.kind} to be static, found {actor.motion}"


def _check_conflict_relation(proposal: Proposal) -> Iterator[str]:
    if len(proposal.ego_vehicles) > 1 and not _relation_types(proposal) & CONFLICT_RELATIONS:
        yield f"vehicle_constraints: expected at least one of {', '.join(sorted(CONFLICT_RELATIONS))}, found none"


def _check_oncoming_relation(proposal: Proposal) -> Iterator[str]:
    if proposal.needs_oncoming and "opposite_approach_of" not in _relation_types(proposal):
        yield "vehicle_constraints: expected opposite_approach_of because of needs_oncoming, found none"


def _check_lane_relation(proposal: Proposal) -> Iterator[str]:
    if proposal.needs_multi_lane and not _relation_types(proposal) & LANE_RELATIONS:
        yield "vehicle_constraints: expected a lane relation because of needs_multi_lane, found none"


def _check_merge_relation(proposal: Proposal) -> Iterator[str]:
    if (proposal.needs_merge or proposal.needs_on_ramp) and "merges_into_lane_of" not in _relation_types(proposal):
        yield "vehicle_constraints: expected merges_into_lane_of because of the merge, found none"


def _check_ramp_roads(proposal: Proposal) -> Iterator[str]:
    if not proposal.needs_on_ramp:
        return
    roads = {ego.entry_road for ego in proposal.ego_vehicles}
    if not {"main", "side"} <= roads:
        yield f"ego_vehicles: expected one main and one side entry_road for the ramp, found {', '.join(sorted(roads))}"


def _check_unprotected_left(proposal: Proposal) -> Iterator[str]:
    if proposal.category is not Category.UNPROTECTED_LEFT:
        return
    maneuver = {ego.vehicle_id: ego.maneuver for ego in proposal.ego_vehicles}
    pairs = [{maneuver.get(c.a), maneuver.get(c.b)} for c in proposal.vehicle_constraints if _opposite(c.type)]
    if {"left", "straight"} not in pairs:
        yield "ego_vehicles: expected a left turn opposite a straight drive, found none"


def _opposite(type_: str) -> bool:
    return type_ == "opposite_approach_of"


def _check_walkers(proposal: Proposal) -> Iterator[str]:
    if proposal.category is Category.CROSSWALK and not any(actor.kind == "walker" for actor in proposal.actors):
        yield "actors: expected at least one walker for crosswalk, found none"


def _check_no_lane_change(proposal: Proposal) -> Iterator[str]:
    changing = [ego.vehicle_id for ego in proposal.ego_vehicles if ego.maneuver == "lane_change"]
    if proposal.category is Category.BLOCKED_LANE and changing:
        yield f"ego_vehicles: expected no lane_change for blocked-lane, found {', '.join(changing)}"


def _check_overtaking(proposal: Proposal) -> Iterator[str]:
    if proposal.category is not Category.OVERTAKING:
        return
    ahead = [a for a in proposal.actors if a.affects_vehicle == "Vehicle 1" and a.motion == "static"]
    if not ahead:
        yield "actors: expected something parked on the lane of Vehicle 1 for overtaking, found none"
    opposite = {("Vehicle 1", "Vehicle 2"), ("Vehicle 2", "Vehicle 1")}
    if not any((c.a, c.b) in opposite and _opposite(c.type) for c in proposal.vehicle_constraints):
        yield "vehicle_constraints: expected Vehicle 2 opposite_approach_of Vehicle 1 for overtaking, found none"


def _check_typology(proposal: Proposal) -> Iterator[str]:
    if (proposal.category is Category.PRE_CRASH) != (proposal.pre_crash is not None):
        wanted = "a typology number" if proposal.category is Category.PRE_CRASH else "none"
        yield f"pre_crash: expected {wanted} for {proposal.category}, found {proposal.pre_crash or 'none'}"


def _relation_types(proposal: Proposal) -> set[str]:
    return {constraint.type for constraint in proposal.vehicle_constraints}


RULES: tuple[Callable[[Proposal], Iterator[str]], ...] = (
    _check_topology,
    _check_needs,
    _check_ego_count,
    _check_ego_ids,
    _check_actor_count,
    _check_actor_ids,
    _check_known_ids,
    _check_no_self_relation,
    _check_contradictions,
    _check_crossing_actors,
    _check_static_actors,
    _check_conflict_relation,
    _check_oncoming_relation,
    _check_lane_relation,
    _check_merge_relation,
    _check_ramp_roads,
    _check_unprotected_left,
    _check_walkers,
    _check_no_lane_change,
    _check_overtaking,
    _check_typology,
)
