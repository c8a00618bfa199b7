"""Pedestrians step out from between parked vehicles of a dense corridor; oncoming CAVs or masts see them wait.

Two thirds of the sites are farm yards at a fast road, out of which riders of e-scooters come.
"""

from dataclasses import dataclass

import shapely

from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values, load_network
from mdrive_sumo.generate.hard.family_streets import CORRIDORS, Corridor
from mdrive_sumo.generate.hard.passage_pedestrian import STREETS, build_passage_scene
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.encounters.crossing_users import StepOut
from mdrive_sumo.worlds.placement.bodies import BODIES, build_mast
from mdrive_sumo.worlds.placement.cavs import build_platoon
from mdrive_sumo.worlds.placement.lane_chains import (
    Lanes,
    compute_chain_length,
    compute_pose,
    find_lane_start,
    find_station_beside,
)
from mdrive_sumo.worlds.placement.parked_vehicles import PAVEMENT_M, FreePlace, build_kerbside
from mdrive_sumo.worlds.streams.edge_streams import build_traffic

SITES = ((0, 1), (0, 2), (0, 4), (1, 1), (1, 2), (1, 3), (2, 1), (2, 2), (2, 3))
"""Corridor and segment of the first pedestrian."""
SPACING_M = 48.0
"""[m] Between pedestrians."""
JUNCTION_M = (24.0, 22.0)
"""[m] No pedestrian crosses closer to the begin or the end of a segment."""
KERB_M = 4.45
"""[m] From the centre of the lane to where a pedestrian waits directly behind the vehicle that hides it."""
DOOR_M = 10.5
"""[m] From the centre of the lane to where a pedestrian begins: inside the house, out of sight until it starts."""
DOOR_WALL_M = 1.2
"""[m] Least distance of that place from the walls."""
DOOR_SHIFTS_M = (0.0, 1.5, -1.5, 3.0, -3.0, 4.5, -4.5, 6.0, -6.0)
MEAN_SPEED = 12.0
"""[m/s] Of CAV 0, by which the oncoming CAV is timed."""
RIM_M = 3.0
"""[m] Least distance of a goal from the end of its lanes."""


@dataclass(frozen=True, slots=True)
class _Street:
    """The street of a candidate: chains of the CAV and of oncoming traffic, and the pedestrians' stations [m]."""

    corridor: Corridor
    roads: RoadMap
    own: Lanes
    oncoming: Lanes
    places: tuple[float, ...]
    goal_m: float
    """Station [m] of the goal of CAV 0."""


def _find_street(values: Values) -> _Street:
    corridor_index, segment = SITES[int(values["site"])]
    corridor = CORRIDORS[corridor_index]
    roads = load_network(corridor.network)
    own = corridor.find_chain(roads, "east", corridor.lanes[0])
    segments = [
        (find_lane_start(roads, own, lane), roads.lanes[lane].centre.length)
        for lane in own
        if not roads.lanes[lane].junction
    ][segment:]
    begin, length = segments[0]
    wanted = begin + JUNCTION_M[0] + values["place"] * (length - sum(JUNCTION_M))
    places: list[float] = []
    for begin, length in segments:
        while (place := max(wanted, begin + JUNCTION_M[0])) <= begin + length - JUNCTION_M[1]:
            places.append(_find_door(roads, own, place))
            wanted = places[-1] + SPACING_M
    places = places[: round(values["pedestrians"])]
    goal = min(places[-1] + values["beyond_m"], compute_chain_length(roads, own) - RIM_M)
    oncoming = corridor.find_chain(roads, "west", corridor.lanes[-1])
    return _Street(corridor, roads, own, oncoming, tuple(places), goal)


def _find_door(roads: RoadMap, own: Lanes, wanted: float) -> float:
    """Return the station [m] nearest to the wanted one whose door lies in a house; the wanted one if none is near."""
    for shift in DOOR_SHIFTS_M:
        door = compute_pose(roads, own, wanted + shift, -DOOR_M)
        place = shapely.Point(door.x, door.y).buffer(DOOR_WALL_M)
        if any(building.contains(place) for building in roads.building_shapes):
            return wanted + shift
    return wanted


def stage_occluded_pedestrian(values: Values, seed: str) -> FamilyScene:
    """Return the scene of a candidate: CAV 0 passes the parked row, CAV 1 comes from ahead."""
    if values["site"] >= len(SITES):
        return build_passage_scene(STREETS[(int(values["site"]) - len(SITES)) % len(STREETS)], values, seed)
    street = _find_street(values)
    roads, places = street.roads, street.places
    start = max(places[0] - values["own_m"], 3.0)
    names = [str(k) for k in range(round(values["cavs"]) - (values["mast"] < 0.5))]
    line = build_platoon(roads, names, street.own, (start, 22.0), (street.goal_m, values["own_speed"]))
    egos = (*line, *_build_oncoming(street, values, places[0] - start))
    walkers = [_build_pedestrian(street, line[k % len(line)], k, values) for k in range(len(places))]
    model = "bus" if values["bus"] >= 0.5 else "van"
    free = [FreePlace(place, place + values["free_m"], model) for place in places]
    parked = build_kerbside(roads, street.own, free, (start - 20.0, places[-1] + 60.0), seed)
    left = street.corridor.find_chain(roads, "west", street.corridor.lanes[0])
    end, begin, *beside = (
        find_station_beside(roads, left, street.own, station) for station in (start, places[-1] + 40.0, *places)
    )
    free_left = [FreePlace(station - 3.0, station + 3.0) for station in beside]
    parked += build_kerbside(roads, left, free_left, (min(begin, end), max(begin, end)), seed)
    actors = (*walkers, *parked)
    vehicles = build_traffic(roads, street.corridor.all_streams, round(values["vehicles"]), seed, (*egos, *walkers))
    rsus = _build_masts(street) if values["mast"] >= 0.5 else ()
    return FamilyScene(roads, egos, vehicles, actors, rsus, signals=True)


def _build_pedestrian(street: _Street, cav: Ego, k: int, values: Values) -> Actor:
    """Return pedestrian k, who crosses the whole street when the CAV is `lead_m` away from the place on its route."""
    corridor = street.corridor
    width = 2 * len(corridor.lanes) * 3.3 + (6.6 if corridor.network.endswith("arterial") else 0.0)
    offsets = (-(DOOR_M if values["door"] >= 0.5 else KERB_M), width - 1.65 + 3.0)
    step = StepOut(BODIES["adult"], street.places[k], offsets, values["walking_speed"], values["lead_m"])
    return step.build(street.roads, street.own, f"walker{k}", cav)


def _build_oncoming(street: _Street, values: Values, own_m: float) -> list[Ego]:
    """Return the CAV from ahead that is `witness_m` before the pedestrian when CAV 0 is near; none with masts."""
    if values["mast"] >= 0.5:
        return []
    place = find_station_beside(street.roads, street.oncoming, street.own, street.places[0])
    front = max(place - values["witness_m"] - own_m * 0.7, 3.0)
    return build_platoon(street.roads, ["oncoming"], street.oncoming, (front, 26.0), (place + 50.0, MEAN_SPEED))


def _build_masts(street: _Street) -> tuple[RoadsideUnit, ...]:
    poses = [compute_pose(street.roads, street.own, place + 9.0, -PAVEMENT_M) for place in street.places]
    return tuple(build_mast(f"mast{k}", pose) for k, pose in enumerate(poses))


FAMILY = ScenarioFamily(
    category="occluded-pedestrian",
    description="Pedestrians step out from between parked vehicles, or ride e-scooters out of a farm yard.",
    parameters=(
        FamilyParameter("site", 0.0, 3.0 * len(SITES), "", "corridor and segment, or road with farm yards"),
        FamilyParameter("place", 0.0, 1.0, "", "place of the first pedestrian in the segment"),
        FamilyParameter("own_m", 32.0, 120.0, "m", "distance of CAV 0 from the first pedestrian"),
        FamilyParameter("own_speed", 8.0, 13.8, "m/s", "start speed of CAV 0; 1.5 times that on a fast road"),
        FamilyParameter("lead_m", 12.0, 100.0, "m", "distance of CAV 0 at which a pedestrian starts"),
        FamilyParameter("walking_speed", 1.2, 3.3, "m/s", "speed of the pedestrians"),
        FamilyParameter("riding_speed", 5.5, 6.9, "m/s", "speed of e-scooters out of passages"),
        FamilyParameter(
            "door", 0.0, 1.0, "", "whether pedestrians come out of a house (from 0.5 on) or wait at the kerb"
        ),
        FamilyParameter("beyond_m", 40.0, 150.0, "m", "distance from the last pedestrian to the goal of CAV 0"),
        FamilyParameter("free_m", 4.0, 16.0, "m", "length of the free place before which the pedestrians wait"),
        FamilyParameter(
            "bus", 0.0, 1.0, "", "whether a bus at its stop hides the pedestrians, not a van (from 0.5 on)"
        ),
        FamilyParameter("witness_m", 10.0, 60.0, "m", "distance of the oncoming CAV when CAV 0 is close"),
        FamilyParameter("pedestrians", 1.0, 3.0, "", "number of pedestrians"),
        FamilyParameter(
            "mast", 0.0, 1.0, "", "whether roadside units see the pedestrians (from 0.5 on), or an oncoming CAV"
        ),
        FamilyParameter("cavs", 2.0, 5.0, "", "number of CAVs"),
        FamilyParameter("vehicles", 0.0, 140.0, "", "number of reactive vehicles"),
    ),
    stage=stage_occluded_pedestrian,
)
