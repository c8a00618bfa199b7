"""A scenario drawn on any network: CAVs that meet at a junction, people who cross their routes, and traffic."""

from collections.abc import Mapping
from random import Random

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import Lane, RoadMap, Route, build_lane_route
from mdrive_sumo.worlds.authoring.scenario_builder import ScenarioBuilder
from mdrive_sumo.worlds.encounters.crossing_users import CrossingRequest, build_crossing_users
from mdrive_sumo.worlds.placement.cavs import NoRoomError
from mdrive_sumo.worlds.traffic import find_demand

MOST_CAVS = 32
"""Of a scenario file."""
TRIES = 40
"""Draws before a network is taken to have no room: on the packaged networks one of the first three has."""
RING = "roundabout"
"""Stands for all entries of the roundabouts of a network."""
MOST_LANES = 24
"""Of a route: a longer one goes in circles."""
RUN_UP_M = (18.0, 45.0)
"""[m] From the start of a CAV to the junction; the original uses 28 m on average."""
RUN_OUT_M = (20.0, 40.0)
"""[m] From the junction to the goal."""
MOST_CROSSING = 2
"""People who cross the routes of CAVs: from 0 to this number."""
HIDDEN_SHARE = 0.5
"""Share of those that stand behind a parked vehicle."""


def draw_scenario(draft: ScenarioBuilder, cavs: int, demand: str, rng: Random) -> None:
    """Add drawn CAVs, crossing people and traffic to an empty scenario. Raises InputError if there is no room."""
    roads = draft.roads
    find_demand(demand)
    if not 1 <= cavs <= MOST_CAVS:
        raise InputError(f"cavs: expected 1 to {MOST_CAVS}, found {cavs}")
    for _ in range(TRIES):
        draft.clear()
        try:
            for route in _draw_routes(roads, cavs, rng):
                draft.add_route(route)
            _add_crossing_people(draft, rng)
            draft.add_traffic(demand, rng.getrandbits(32))
            draft.build()
        except InputError:
            continue
        return
    raise InputError(
        f"network {roads.name}: expected room for {cavs} CAVs that meet, found none in {TRIES} draws; fewer may have it"
    )


def _draw_routes(roads: RoadMap, count: int, rng: Random) -> list[Route]:
    """Return routes through one junction, each from another lane; without junctions, routes along lanes."""
    entries = _find_entries(roads)
    if not entries:
        ways = sorted(lane.id for lane in roads.driving if not lane.junction)
        return [_draw_along(roads.lanes[name], roads, rng) for name in rng.sample(ways, min(count, len(ways)))]
    node = rng.choice(sorted(entries))
    chosen = rng.sample(entries[node], min(count, len(entries[node])))
    if len(chosen) < count:
        raise NoRoomError(f"junction {node}: expected {count} approaches, found {len(chosen)}")
    return [_draw_through(roads.lanes[before], rng.choice(vias), roads, rng) for before, vias in chosen]


def _find_entries(roads: RoadMap) -> Mapping[str, list[tuple[str, list[str]]]]:
    """Return the ways into each junction: lanes before it, each with the lanes inside that follow."""
    entries: dict[str, dict[str, list[str]]] = {}
    for lane in roads.driving:
        for after in lane.successors:
            if lane.edge not in roads.roundabout_edges and not lane.junction and after in roads.junction_controls:
                node = roads.lanes[after].edge[1:].rpartition("_")[0]
                node = RING if roads.junction_controls[after] == "roundabout" else node
                entries.setdefault(node, {}).setdefault(lane.id, []).append(after)
    return {node: sorted(ways.items()) for node, ways in entries.items()}


def _draw_through(before: Lane, via: str, roads: RoadMap, rng: Random) -> Route:
    """Return a route from before a junction to behind it, past further junctions where roads are short."""
    lanes = [before.id, via]
    run_up, run_out = rng.uniform(*RUN_UP_M), rng.uniform(*RUN_OUT_M)
    while (last := roads.lanes[lanes[-1]]).junction or (run_out > last.centre.length and last.successors):
        run_out -= 0.0 if last.junction else last.centre.length
        lanes.append(rng.choice(_list_successors(roads, last.id)))
        if len(lanes) > MOST_LANES:
            raise NoRoomError(f"lane {before.id}: expected a way out of the junction behind it, found none")
    start_s = max(before.centre.length - run_up, 3.0)
    return build_lane_route(roads, lanes, start_s, min(run_out, last.centre.length - 1.0))


def _list_successors(roads: RoadMap, lane: str) -> tuple[str, ...]:
    successors = roads.lanes[lane].successors
    if not successors:
        raise NoRoomError(f"lane {lane}: expected a way out of its junction, found none")
    return successors


def _draw_along(lane: Lane, roads: RoadMap, rng: Random) -> Route:
    length = lane.centre.length
    start = rng.uniform(3.0, max(length - RUN_OUT_M[1] - RUN_UP_M[0], 3.0))
    return build_lane_route(roads, (lane.id,), start, min(start + RUN_OUT_M[1] + RUN_UP_M[0], length - 1.0))


def _add_crossing_people(draft: ScenarioBuilder, rng: Random) -> None:
    requests = [CrossingRequest("adult", rng.random() < HIDDEN_SHARE) for _ in range(rng.randint(0, MOST_CROSSING))]
    for actor in build_crossing_users(draft.roads, draft.egos, requests, rng):
        draft.add_actor(actor)
