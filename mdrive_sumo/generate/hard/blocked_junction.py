"""Drive through the gap of a queue that blocks a junction, across a lane beside the queue that still moves.

CAV 0 turns left out of a side street of a corridor, or goes straight on in a one-way street, where it is faster.
"""

from dataclasses import dataclass

from mdrive_sumo.generate.hard.family import (
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
    build_encounter_parameters,
    load_network,
)
from mdrive_sumo.generate.hard.family_streets import CORRIDORS
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scripted_actor import Actor, StartMotion, TimeTrigger
from mdrive_sumo.worlds.encounters.hidden_vehicle import Encounter, place_encounter
from mdrive_sumo.worlds.placement.bodies import build_driving_actor, space_vehicles
from mdrive_sumo.worlds.placement.lane_chains import Lanes, find_conflict
from mdrive_sumo.worlds.streams.edge_streams import TrafficStream, build_standing_queue, build_traffic

CORRIDOR = CORRIDORS[0]
AHEAD_GAP_M = 3.0
"""[m] From the side of CAV 0 to the vehicles that stand beyond it."""
GREEN_S = 28.0
"""[s] The light ahead of the queue turns green for it."""
SET_OFF_S = 3.0
"""[s] Between the departures of vehicles in the queue."""
QUEUE = ("car", "van", "car", "truck", "car", "car", "van", "car")
"""From the light back."""
BLOCKING_GAP_M = 0.7
"""[m] Between blocking vehicles."""
BLOCKING_SPEED = 9.0
"""[m/s] Of the vehicles that block the junction, once they can drive on."""


@dataclass(frozen=True, slots=True)
class QueueSite:
    """A side street without a light, in front of which a queue has left a gap."""

    network: str
    own: tuple[str, str]
    """First and last lane of CAV 0."""
    hidden: tuple[str, str]
    """Those of the lane that moves."""
    queue: tuple[str, str]
    """Those of the queue's lane, which CAV 0 crosses first."""
    mean_speed: float
    """[m/s] Of CAV 0 until the conflict."""
    half_path_m: float
    """[m] From the place where centres come together to the side of CAV 0."""
    streams: tuple[TrafficStream, ...]
    ahead: tuple[str, ...] = ()
    """Edges from the side street to the light for which the queue waits, and on; () if the queue goes on unseen."""
    behind: str = ""
    """Edge of the end of the queue."""


def _build_corridor_site(direction: str, own: tuple[str, str], ahead: int) -> QueueSite:
    ends = (0, CORRIDOR.junctions) if direction == "east" else (CORRIDOR.junctions, 0)
    right, left = CORRIDOR.lanes[0], CORRIDOR.lanes[-1]
    segments = range(ahead, ends[1] + 1) if direction == "east" else range(ahead, -1, -1)
    return QueueSite(
        CORRIDOR.network,
        own,
        (f"{direction}_{ends[0]}_{left}", f"{direction}_{ends[1]}_{left}"),
        (f"{direction}_{ends[0]}_{right}", f"{direction}_{ends[1]}_{right}"),
        8.5,
        2.6,
        CORRIDOR.all_streams,
        tuple(f"{direction}_{k}" for k in segments),
        f"{direction}_{ahead - 1 if direction == 'east' else ahead + 1}",
    )


def _build_straight_site(direction: str, near: int) -> QueueSite:
    """Return a crossing with the lanes of a direction, of which CAV 0 crosses lane `near` first."""
    ends = ("east_0", "east_1") if direction == "east" else ("west_1", "west_0")
    far = 3 - near
    other = ("west_1", "west_0") if direction == "east" else ("east_0", "east_1")
    return QueueSite(
        "hard_queue_crossing",
        ("south_1_in_0", "north_1_out_0"),
        (f"{ends[0]}_{far}", f"{ends[1]}_{far}"),
        (f"{ends[0]}_{near}", f"{ends[1]}_{near}"),
        13.0,
        1.2,
        (TrafficStream(other, (1, 2), 0.5), TrafficStream(ends, (far,), 0.3)),
    )


SITES = (
    _build_corridor_site("east", ("south_2_in_1", "west_0_3"), 2),
    _build_straight_site("east", 1),
    _build_corridor_site("west", ("north_4_in_1", "east_5_3"), 3),
    _build_straight_site("west", 2),
)


def stage_blocked_junction(values: Values, seed: str) -> FamilyScene:
    """Return the scene of a candidate: CAV 0 drives through the gap, CAV 1 follows the hidden vehicle."""
    site = SITES[min(int(values["site"]), len(SITES) - 1)]
    roads = load_network(site.network)
    own, hidden, queue = (find_lane_path(roads, *ends) for ends in (site.own, site.hidden, site.queue))
    placed = place_encounter(roads, Encounter(own, hidden, hidden, site.mean_speed, 11.0), values)
    at_m, half_m = find_conflict(roads, own, queue)[1], site.half_path_m
    blocking = _build_blocking(roads, queue, at_m - half_m - values["gap_m"], round(values["blocking"]))
    beyond = () if site.ahead else _build_beyond(roads, queue, at_m + half_m + AHEAD_GAP_M)
    egos, actors = placed.egos, (*placed.actors, *blocking, *beyond)
    standing = _build_standing(roads, site)
    vehicles = build_traffic(roads, site.streams, round(values["vehicles"]), seed, (*egos, *actors))
    free = tuple(one for one in vehicles if not _is_in_queue(one, site))
    return FamilyScene(roads, egos, (*standing, *free), actors, placed.rsus, signals=bool(site.ahead))


def _build_standing(roads: RoadMap, site: QueueSite) -> tuple[BackgroundVehicle, ...]:
    """Return the reactive vehicles that wait for the light ahead."""
    if not site.ahead:
        return ()
    lane = f"{site.ahead[0]}_{CORRIDOR.lanes[0]}"
    return build_standing_queue(roads, lane, site.ahead, QUEUE, 1.0, "queue")


def _is_in_queue(one: BackgroundVehicle, site: QueueSite) -> bool:
    """Return whether a vehicle would start on the lanes of the queue or beside its end."""
    return bool(site.ahead) and one.depart_s == 0.0 and one.edges[0] in (site.ahead[0], site.behind)


def _build_waiting(roads: RoadMap, name: str, model: str, place: tuple[Lanes, float], at_s: float) -> Actor:
    """Return a vehicle that stands in the queue, its middle at a station [m] of its chain, and drives on at `at_s`."""
    drive = (*place, BLOCKING_SPEED)
    return build_driving_actor(roads, name, model, drive, trigger=TimeTrigger(at_s=at_s), action=StartMotion())


def _build_beyond(roads: RoadMap, queue: Lanes, rear: float) -> list[Actor]:
    """Return the vehicles of the queue beyond the gap, from a station [m] on; they drive on first."""
    places = enumerate(space_vehicles(reversed(QUEUE), rear, AHEAD_GAP_M, step=1.0))
    last_s = GREEN_S + SET_OFF_S * (len(QUEUE) - 1)
    return [
        _build_waiting(roads, f"queue{i}", model, (queue, middle), last_s - SET_OFF_S * i)
        for i, (model, middle) in places
    ]


def _build_blocking(roads: RoadMap, queue: Lanes, front: float, count: int) -> list[Actor]:
    """Return buses and trucks in the queue before the gap, the first with its front at a station [m].

    They drive on when the light ahead has turned green.
    """
    places = enumerate(space_vehicles([("bus", "truck", "van")[i % 3] for i in range(count)], front, BLOCKING_GAP_M))
    first_s = GREEN_S + SET_OFF_S * len(QUEUE)
    return [
        _build_waiting(roads, f"blocking{i}", model, (queue, middle), first_s + SET_OFF_S * i)
        for i, (model, middle) in places
    ]


FAMILY = ScenarioFamily(
    category="blocked-junction",
    description="Drive through the gap of a queue that blocks a junction, across a lane that still moves.",
    parameters=(
        FamilyParameter("site", 0.0, float(len(SITES)), "", "side street"),
        *build_encounter_parameters((40.0, 100.0), (7.0, 14.0), (10.0, 13.8)),
        FamilyParameter("gap_m", 0.8, 4.0, "m", "distance of the first blocking vehicle from the side of CAV 0"),
        FamilyParameter("blocking", 1.0, 5.0, "", "number of blocking vehicles"),
        FamilyParameter("mast", 0.0, 1.0, "", "whether a roadside unit hangs above the junction (from 0.5 on)"),
        FamilyParameter("cavs", 2.0, 10.0, "", "number of CAVs"),
        FamilyParameter("vehicles", 0.0, 120.0, "", "number of reactive vehicles beside the queue"),
    ),
    stage=stage_blocked_junction,
)
