"""Turn through the gap of a queue that blocks a junction, across a lane beside the queue that still moves."""

from dataclasses import dataclass

from mdrive_sumo.generate.hard.family import FamilyCandidate, FamilyParameter, ScenarioFamily
from mdrive_sumo.generate.hard.family_encounter import (
    Encounter,
    build_encounter_parameters,
    build_followers,
    build_mast,
    place_encounter,
)
from mdrive_sumo.generate.hard.family_parts import (
    BODY_SIZES,
    FamilyTraffic,
    Lanes,
    build_driving_actor,
    build_scenario,
    find_conflict,
    load_network,
    read_values,
)
from mdrive_sumo.generate.hard.family_streets import CORRIDORS
from mdrive_sumo.generate.hard.family_traffic import build_standing_queue, build_traffic
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, StartMotion, TimeTrigger

CORRIDOR = CORRIDORS[0]
MEAN_SPEED = 8.5
"""[m/s] Of a CAV that slows down for the turn."""
HALF_PATH_M = 2.6
"""[m] From the place where centres come together to the side of CAV 0."""
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
    """A side street without a light between a queue's light and its end."""

    direction: str
    entry: str
    """Lane of CAV 0."""
    exit: str
    ahead: int
    """Segment of the queue between the side street and the light."""


SITES = (
    QueueSite("east", "south_2_in_1", "west_0_3", 2),
    QueueSite("west", "north_4_in_1", "east_5_3", 3),
)


def build_blocked_junction(candidate: FamilyCandidate) -> Scenario:
    """Return the scenario of a candidate: CAV 0 turns left through the gap, CAV 1 follows the hidden vehicle."""
    values, roads = read_values(FAMILY, candidate), load_network(CORRIDOR.network)
    site = SITES[min(int(values["site"]), len(SITES) - 1)]
    hidden = CORRIDOR.find_chain(roads, site.direction, CORRIDOR.lanes[-1])
    encounter = Encounter(find_lane_path(roads, site.entry, site.exit), hidden, hidden, MEAN_SPEED)
    placed = place_encounter(roads, encounter, values)
    more = round(values["cavs"]) - len(placed.egos)
    followers = build_followers(roads, encounter, placed, more, (values["own_speed"], 11.0))
    queue = CORRIDOR.find_chain(roads, site.direction, CORRIDOR.lanes[0])
    blocking = _build_blocking(roads, encounter, queue, (round(values["blocking"]), values["gap_m"]))
    egos, actors = (*placed.egos, *followers), (*placed.actors, *blocking)
    standing = _build_standing(roads, site)
    vehicles = build_traffic(roads, CORRIDOR.all_streams, round(values["vehicles"]), candidate.seed, (*egos, *actors))
    free = tuple(one for one in vehicles if not _is_in_queue(one, standing, site))
    rsus = (build_mast(roads, encounter),) if values["mast"] >= 0.5 else ()
    return build_scenario(FAMILY, candidate, roads, egos, FamilyTraffic((*standing, *free), actors, rsus, signals=True))


def _build_standing(roads: RoadMap, site: QueueSite) -> tuple[BackgroundVehicle, ...]:
    """Return the reactive vehicles that wait for the light ahead."""
    last = CORRIDOR.junctions + 1
    segments = range(site.ahead, last) if site.direction == "east" else range(site.ahead, -1, -1)
    edges = tuple(f"{site.direction}_{k}" for k in segments)
    lane = f"{edges[0]}_{CORRIDOR.lanes[0]}"
    return build_standing_queue(roads, lane, edges, QUEUE, 1.0, "queue")


def _is_in_queue(one: BackgroundVehicle, standing: tuple[BackgroundVehicle, ...], site: QueueSite) -> bool:
    """Return whether a vehicle would start on the lanes of the queue or beside its end."""
    behind = site.ahead - 1 if site.direction == "east" else site.ahead + 1
    return one.depart_s == 0.0 and one.edges[0] in (standing[0].edges[0], f"{site.direction}_{behind}")


def _build_blocking(roads: RoadMap, encounter: Encounter, queue: Lanes, row: tuple[int, float]) -> list[Actor]:
    """Return buses and trucks in the queue before the gap; `row`: their number, and the first one's gap [m].

    They drive on when the light has turned green.
    """
    front = find_conflict(roads, encounter.own, queue)[1] - HALF_PATH_M - row[1]
    made: list[Actor] = []
    for i in range(row[0]):
        model = ("bus", "truck", "van")[i % 3]
        length = BODY_SIZES[model][0]
        actor = build_driving_actor(roads, f"blocking{i}", model, (queue, front - length / 2, BLOCKING_SPEED))
        motion = actor.motion.model_copy(update={"start_speed": 0.0})
        trigger = TimeTrigger(at_s=GREEN_S + SET_OFF_S * (len(QUEUE) + i))
        made.append(actor.model_copy(update={"motion": motion, "trigger": trigger, "action": StartMotion()}))
        front -= length + BLOCKING_GAP_M
    return made


FAMILY = ScenarioFamily(
    category="blocked-junction",
    description="Turn through the gap of a queue that blocks a junction, across a lane that still moves.",
    parameters=(
        FamilyParameter("site", 0.0, float(len(SITES)), "", "side street"),
        *build_encounter_parameters((30.0, 85.0), (3.0, 11.0), (8.0, 13.8)),
        FamilyParameter("gap_m", 1.0, 6.0, "m", "distance of the first blocking vehicle from the side of CAV 0"),
        FamilyParameter("blocking", 1.0, 5.0, "", "number of blocking vehicles"),
        FamilyParameter("mast", 0.0, 1.0, "", "whether a roadside unit hangs above the junction (from 0.5 on)"),
        FamilyParameter("cavs", 2.0, 8.0, "", "number of CAVs"),
        FamilyParameter("vehicles", 0.0, 120.0, "", "number of reactive vehicles beside the queue"),
    ),
    build=build_blocked_junction,
)
