"""Situations of training scenarios: which CAVs drive where, and what else is on the road, before anything has a place.

Each situation is one function that draws a `SituationPlan` on a drawn place, or None where the place cannot stage it.
"""

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.encounters.proposed_actor import ProposedActor
from mdrive_sumo.worlds.lane_routes import LaneRoute, are_opposite, find_lane_change_routes, find_lane_routes

Ways = dict[str, LaneRoute]
"""Lane routes of the CAVs by the vehicle ids of proposals."""
MOST_CAVS = 5
DENSE_TRAFFIC = (20, 84)
"""Background vehicles of dense traffic; V2XPnP's scenarios have 84 on average."""
CROWD = (30, 90)
"""Scripted and parked road users of a crowded place, as many as recordings have."""
STREETS = frozenset(("crossing", "town_block", "car_park", "driveways", "corridor", "residential_street", "arterial"))
"""Kinds of places with pavements."""
SLOW_ROADS = STREETS | {"roundabout", "country_road", "works_zone"}
"""Kinds of places where people and cyclists may cross."""


@dataclass(frozen=True, slots=True)
class SituationPlan:
    """What a training scenario shall hold."""

    ways: Ways
    route_m: tuple[float, float] = (45.0, 130.0)
    """Bounds of the length of the CAVs' routes [m]."""
    obstacles: tuple[ProposedActor, ...] = ()
    """What `worlds.encounters.route_actors` places."""
    walkers: int = 0
    hidden_walkers: int = 0
    """Of `walkers`, those that step out from behind parked vehicles."""
    crossing_cyclists: int = 0
    leading_cyclists: int = 0
    """Cyclists ahead in the lane of the first CAV."""
    parked: int = 0
    """Vehicles parked at the roadside."""
    queue: int = 0
    """Background vehicles that stand one behind the other ahead of the first CAV."""
    traffic: int = 0
    """Background vehicles elsewhere."""
    is_jammed: bool = False
    """Whether background vehicles may start with short gaps and low speeds."""
    crowd: int = 0
    """Scripted and parked road users at most, drawn with the traffic of a town around them; 0: none of these."""


@dataclass(frozen=True, slots=True)
class TrainingSituation:
    """A kind of training scenario."""

    share: float
    """Share of all training scenarios that is aimed at."""
    draw: Callable[[RoadMap, random.Random], SituationPlan | None]
    kinds: frozenset[str] = field(default_factory=frozenset[str])
    """Kinds of places that can stage it; empty: any."""

    def fits(self, kind: str) -> bool:
        """Return whether a place of that kind may stage the situation."""
        return not self.kinds or kind in self.kinds


def _name_vehicles(ways: Sequence[LaneRoute]) -> Ways:
    return {f"Vehicle {n}": way for n, way in enumerate(ways, 1)}


def _draw_routes(roads: RoadMap, rng: random.Random, count: int, change_share: float = 0.15) -> list[LaneRoute]:
    """Return routes from different entries where there are enough; some change lanes."""
    plain, changing = find_lane_routes(roads), find_lane_change_routes(roads)
    chosen: list[LaneRoute] = []
    for _ in range(count):
        pool = changing if changing and rng.random() < change_share else plain
        used = {way.entry for way in chosen}
        fresh = [way for way in pool if way.entry not in used]
        chosen.append(rng.choice(fresh if fresh and rng.random() < 0.8 else list(pool)))
    return chosen


def _draw_small_traffic(rng: random.Random, most: int = 5) -> int:
    """Return a number of background vehicles: none in half of the scenarios."""
    return rng.randint(1, most) if rng.random() < 0.5 else 0


def _draw_parked(rng: random.Random) -> int:
    return rng.randint(1, 6) if rng.random() < 0.4 else 0


def _draw_lone(roads: RoadMap, rng: random.Random) -> SituationPlan:
    """One CAV, and no other road user."""
    return SituationPlan(_name_vehicles(_draw_routes(roads, rng, 1, 0.1)), (60.0, 220.0))


def _draw_meeting(roads: RoadMap, rng: random.Random) -> SituationPlan:
    """CAVs from several sides."""
    ways = _draw_routes(roads, rng, rng.randint(2, MOST_CAVS))
    return SituationPlan(_name_vehicles(ways), parked=_draw_parked(rng), traffic=_draw_small_traffic(rng, 3))


def _draw_oncoming_left(roads: RoadMap, rng: random.Random) -> SituationPlan | None:
    """A CAV turns left; CAVs or other vehicles come towards it."""
    ways = find_lane_routes(roads)
    left = [way for way in ways if way.turn == "left"]
    if not left:
        return None
    first = rng.choice(left)
    oncoming = [way for way in ways if are_opposite(first, way) and way.turn in ("straight", "right")]
    count = rng.randint(0, 2) if oncoming else 0
    chosen = [first, *(rng.choice(oncoming) for _ in range(count))]
    chosen += [first] * (rng.random() < 0.3)
    traffic = rng.randint(2, 8) if count == 0 else _draw_small_traffic(rng, 4)
    return SituationPlan(_name_vehicles(chosen), traffic=traffic)


def _draw_queue(roads: RoadMap, rng: random.Random) -> SituationPlan:
    """CAVs follow each other, sometimes towards vehicles that stand."""
    way = rng.choice(find_lane_routes(roads))
    ways = [way] * rng.randint(1, 4)
    queue = rng.randint(1, 4) if len(ways) == 1 or rng.random() < 0.5 else 0
    ways += _draw_routes(roads, rng, rng.randint(0, MOST_CAVS - len(ways)), 0.0) if rng.random() < 0.4 else []
    return SituationPlan(_name_vehicles(ways), queue=queue, traffic=_draw_small_traffic(rng, 4))


def _draw_obstacle(roads: RoadMap, rng: random.Random) -> SituationPlan:
    """Something stands in the lane of the first CAV; others may come towards it or beside it."""
    ways = _draw_routes(roads, rng, rng.randint(1, 3), 0.0)
    kind = rng.choice(("static_prop", "parked_vehicle"))
    quantity = rng.randint(1, 3) if kind == "static_prop" else rng.choice((1, 1, 2))
    block = ProposedActor.model_validate(
        {
            "actor_id": "block",
            "kind": kind,
            "quantity": quantity,
            "group_pattern": "along_lane" if kind == "parked_vehicle" else rng.choice(("across_lane", "along_lane")),
            "affects_vehicle": "Vehicle 1",
            "timing_phase": rng.choice(("on_approach", "after_exit")),
            "lateral_position": rng.choice(("center", "half_right", "right_edge")),
        }
    )
    obstacles = (block, *_draw_cones(rng))
    return SituationPlan(_name_vehicles(ways), (55.0, 130.0), obstacles, traffic=_draw_small_traffic(rng, 3))


def _draw_cones(rng: random.Random) -> tuple[ProposedActor, ...]:
    """Return a taper of cones, as at road works, in a quarter of the calls."""
    if rng.random() >= 0.25:
        return ()
    fields = {
        "actor_id": "cones",
        "kind": "static_prop",
        "quantity": rng.randint(3, 5),
        "group_pattern": "diagonal",
        "start_lateral": "right_edge",
        "end_lateral": rng.choice(("half_right", "center")),
        "affects_vehicle": "Vehicle 1",
        "timing_phase": "on_approach",
    }
    return (ProposedActor.model_validate(fields),)


def _draw_walkers(roads: RoadMap, rng: random.Random) -> SituationPlan:
    """People cross the routes of the CAVs, some from behind parked vehicles."""
    walkers = rng.randint(1, 3)
    return SituationPlan(
        _name_vehicles(_draw_routes(roads, rng, rng.randint(1, 3))),
        walkers=walkers,
        hidden_walkers=rng.randint(0, walkers),
        parked=_draw_parked(rng),
        traffic=_draw_small_traffic(rng, 3),
    )


def _draw_cyclists(roads: RoadMap, rng: random.Random) -> SituationPlan:
    """Cyclists cross, or ride ahead of a CAV."""
    crossing = rng.randint(0, 2)
    return SituationPlan(
        _name_vehicles(_draw_routes(roads, rng, rng.randint(1, 3))),
        (60.0, 140.0),
        crossing_cyclists=crossing,
        leading_cyclists=1 if crossing == 0 else rng.randint(0, 1),
        traffic=_draw_small_traffic(rng, 3),
    )


def _draw_traffic(roads: RoadMap, rng: random.Random) -> SituationPlan:
    """A few CAVs among vehicles that SUMO drives."""
    ways = _draw_routes(roads, rng, rng.randint(1, 3))
    return SituationPlan(_name_vehicles(ways), traffic=rng.randint(3, 12), parked=_draw_parked(rng))


def _draw_dense(roads: RoadMap, rng: random.Random) -> SituationPlan:
    """One or two CAVs in dense traffic."""
    ways = _draw_routes(roads, rng, rng.randint(1, 2))
    traffic, parked = rng.randint(*DENSE_TRAFFIC), rng.randint(0, 12)
    return SituationPlan(_name_vehicles(ways), (40.0, 90.0), parked=parked, traffic=traffic, is_jammed=True)


def _draw_crowded(roads: RoadMap, rng: random.Random) -> SituationPlan:
    """CAVs among people on foot, parked vehicles and the traffic of a town."""
    ways = _draw_routes(roads, rng, rng.randint(1, 4), 0.05)
    walkers = rng.randint(0, 2)
    hidden = rng.randint(0, walkers)
    return SituationPlan(
        _name_vehicles(ways), walkers=walkers, hidden_walkers=hidden, crowd=rng.randint(CROWD[0] + 10, CROWD[1])
    )


def _draw_lane_changes(roads: RoadMap, rng: random.Random) -> SituationPlan | None:
    """CAVs side by side that change lanes."""
    changing = find_lane_change_routes(roads)
    if not changing:
        return None
    first = rng.choice(changing)
    beside = [way for way in (*changing, *find_lane_routes(roads)) if way.entry == first.entry]
    ways = [first, *(rng.choice(beside) for _ in range(rng.randint(0, 3)))]
    return SituationPlan(_name_vehicles(ways), (70.0, 150.0), traffic=_draw_small_traffic(rng, 4))


def _draw_going_round(roads: RoadMap, rng: random.Random) -> SituationPlan | None:
    """CAVs go round a roundabout, some almost all the way."""
    ways = find_lane_routes(roads)
    far = [way for way in ways if way.turn in ("left", "u_turn")]
    if not far:
        return None
    chosen = [rng.choice(far), *(rng.choice(ways) for _ in range(rng.randint(0, MOST_CAVS - 1)))]
    return SituationPlan(_name_vehicles(chosen), (80.0, 160.0), traffic=_draw_small_traffic(rng, 4))


def _draw_merge(roads: RoadMap, rng: random.Random) -> SituationPlan | None:
    """CAVs of two lanes want the same one: an on-ramp, or a lane that ends."""
    ways = (*find_lane_routes(roads), *find_lane_change_routes(roads))
    ramps = [way for way in ways if way.entry == "on_ramp"]
    first = rng.choice(ramps if ramps and rng.random() < 0.6 else ways)
    leading_there = [way for way in ways if (way.exit, way.exit_rank) == (first.exit, first.exit_rank)]
    others = [way for way in leading_there if way.lanes[0] != first.lanes[0]]
    if not others:
        return None
    chosen = [first, *(rng.choice((*others, first)) for _ in range(rng.randint(1, MOST_CAVS - 1)))]
    return SituationPlan(_name_vehicles(chosen), (90.0, 170.0), traffic=_draw_small_traffic(rng, 5))


SITUATIONS: Mapping[str, TrainingSituation] = MappingProxyType(
    {
        "lone": TrainingSituation(0.07, _draw_lone),
        "meeting": TrainingSituation(0.11, _draw_meeting),
        "oncoming-left": TrainingSituation(0.07, _draw_oncoming_left, STREETS | {"roundabout"}),
        "queue": TrainingSituation(0.06, _draw_queue),
        "obstacle": TrainingSituation(0.08, _draw_obstacle),
        "walkers": TrainingSituation(0.06, _draw_walkers, SLOW_ROADS),
        "cyclists": TrainingSituation(0.04, _draw_cyclists, SLOW_ROADS),
        "traffic": TrainingSituation(0.07, _draw_traffic),
        "dense": TrainingSituation(0.04, _draw_dense),
        "crowded": TrainingSituation(0.21, _draw_crowded, STREETS),
        "lane-changes": TrainingSituation(
            0.04,
            _draw_lane_changes,
            frozenset(("crossing", "corridor", "arterial", "motorway_merge", "motorway_weave", "motorway_exit")),
        ),
        "roundabout": TrainingSituation(0.03, _draw_going_round, frozenset(("roundabout",))),
        "merge": TrainingSituation(0.03, _draw_merge, frozenset(("motorway_merge", "motorway_weave", "lane_drop"))),
    }
)
"""By name; the shares and that of templates (`training_scenarios`) add up to 1."""
