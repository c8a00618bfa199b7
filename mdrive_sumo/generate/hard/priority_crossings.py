"""Families on crossings of a minor road with a priority road: platoons, mixed traffic, an ambulance.

Each stands at a one-way street and a dual carriageway, and as a second family at crossings of a dense corridor.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values, load_network
from mdrive_sumo.generate.hard.family_streets import CORRIDORS, Corridor
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import build_driving_actor
from mdrive_sumo.worlds.placement.cavs import Platoon, build_platoons
from mdrive_sumo.worlds.placement.lane_chains import Lanes, find_lane_start
from mdrive_sumo.worlds.streams.edge_streams import build_traffic
from mdrive_sumo.worlds.streams.lane_flows import CARS, MIXED, TrafficFlow, build_flows

GOAL_M = 40.0
"""[m] Distance of the goals behind the crossing."""
RIM_M = 6.0
"""[m] Least distance of a CAV from the beginning of its chain."""
VEHICLES_PER_FLOW = 0.04
"""Vehicles in a corridor for one vehicle an hour of each lane of a road: 90 for six flows of 375 veh/h."""

Ends = tuple[str, str]
"""First and last lane of a chain."""


@dataclass(frozen=True, slots=True)
class CrossingRoads:
    """A crossing without lights, driven straight on; lanes of each direction from the right."""

    network: str
    eastward: tuple[Ends, ...]
    westward: tuple[Ends, ...]
    minor: tuple[Ends, ...]
    witness: Ends
    """Chain of the CAVs that see what comes on the last lane of `minor`."""
    rsu: RoadsideUnit
    speed_factor: float = 1.0
    """Speeds of families are those of the fastest of these roads; elsewhere they are multiplied by this."""
    corridor: Corridor | None = None

    def find_chain(self, roads: RoadMap, direction: str, lane: int) -> Lanes:
        """Return a chain of lanes; direction: eastward, westward, minor or witness; the last one if there are fewer."""
        if direction == "witness":
            return find_lane_path(roads, *self.witness)
        ends: Sequence[Ends] = {"eastward": self.eastward, "westward": self.westward, "minor": self.minor}[direction]
        return find_lane_path(roads, *ends[min(lane, len(ends) - 1)])


def _build_one_way() -> CrossingRoads:
    return CrossingRoads(
        "hard_one_way_crossing",
        tuple((f"west_in_{k}", f"east_out_{k}") for k in (0, 1)),
        tuple((f"east_in_{k}", f"west_out_{k}") for k in (0, 1)),
        tuple((f"south_in_{k}", f"north_out_{k}") for k in (0, 1)),
        ("south_in_0", "north_out_0"),
        RoadsideUnit(id="rsu", x=-4.6, y=-9.4),
    )


def _build_corridor_crossing(junction: int, side: str, rsu: tuple[float, float]) -> CrossingRoads:
    """Return a crossing of the narrow corridor; side: from where the minor road comes."""
    other = {"south": "north", "north": "south"}[side]
    return CrossingRoads(
        CORRIDORS[1].network,
        ((f"east_{junction - 1}_2", f"east_{junction}_2"),),
        ((f"west_{junction}_2", f"west_{junction - 1}_2"),),
        ((f"{side}_{junction}_in_1", f"{other}_{junction}_out_1"),),
        (f"{other}_{junction}_in_1", f"{side}_{junction}_out_1"),
        RoadsideUnit(id="rsu", x=rsu[0], y=rsu[1]),
        0.68,
        CORRIDORS[1],
    )


ONE_WAY = _build_one_way()
CORRIDOR_SITES = (
    _build_corridor_crossing(1, "south", (-145.6, -14.6)),
    _build_corridor_crossing(1, "north", (-154.4, 6.8)),
    _build_corridor_crossing(3, "south", (64.4, -8.2)),
    _build_corridor_crossing(3, "north", (55.6, 13.4)),
)
"""Crossings without lights in a corridor. Roadside units stand on the pavement at a corner, from where they see along
both roads."""
SITE_PARAMETER = FamilyParameter("site", 0.0, float(len(CORRIDOR_SITES)), "", "crossing")


@dataclass(frozen=True, slots=True)
class CrossingPlatoon:
    """CAVs of one direction that are due at the crossing."""

    direction: str
    """eastward, westward, minor or witness."""
    lane: int
    count: float
    """Rounded; fewer if they have no room behind each other."""
    speed: float
    """[m/s] Before the site's factor."""
    due_s: float
    """[s] After which the first one is due at the crossing."""
    headway_s: float

    def place(self, roads: RoadMap, site: CrossingRoads) -> Platoon:
        """Return the platoon on the lanes of a crossing."""
        lanes = site.find_chain(roads, self.direction, self.lane)
        speed = self.speed * site.speed_factor
        lead_m = compute_lead(roads, lanes, speed, self.due_s)
        goal_m = find_lane_start(roads, lanes, lanes[-1]) + GOAL_M
        platoon = Platoon(lanes, round(self.count), lead_m, goal_m, speed, self.headway_s)
        return replace(platoon, count=min(platoon.count, 1 + int((lead_m - RIM_M) / platoon.pitch_m)))


def compute_lead(roads: RoadMap, lanes: Lanes, speed: float, due_s: float) -> float:
    """Return the station [m] from which a vehicle reaches the junction of a chain of lanes after `due_s` [s].

    At least `RIM_M`, where the chain is too short.
    """
    inside = next(lane for lane in lanes if roads.lanes[lane].junction)
    return max(find_lane_start(roads, lanes, inside) - speed * due_s, RIM_M)


@dataclass(frozen=True, slots=True)
class CrossingFlow:
    """Traffic that is not connected, on one lane of the priority road."""

    direction: str
    lane: int
    per_hour: float
    models: Mapping[str, float]
    is_entering: bool = False


@dataclass(frozen=True, slots=True)
class CrossingDraft:
    """What a family has at a crossing."""

    platoons: Sequence[CrossingPlatoon]
    flows: Sequence[CrossingFlow]
    has_rsu: bool = False
    actors: tuple[Actor, ...] = ()


Drafter = Callable[[Values, RoadMap, CrossingRoads], CrossingDraft]


def _stage(draft: Drafter, values: Values, seed: str) -> FamilyScene:
    """Return the scene on the road, or in a corridor for values that name a site."""
    site = ONE_WAY
    if SITE_PARAMETER.name in values:
        site = CORRIDOR_SITES[min(int(values[SITE_PARAMETER.name]), len(CORRIDOR_SITES) - 1)]
    roads = load_network(site.network)
    drafted = draft(values, roads, site)
    egos = build_platoons(roads, [platoon.place(roads, site) for platoon in drafted.platoons])
    if site.corridor is not None:
        count = round(VEHICLES_PER_FLOW * sum(flow.per_hour for flow in drafted.flows))
        vehicles = build_traffic(roads, site.corridor.all_streams, count, seed, egos)
    else:
        flows = [
            TrafficFlow(site.find_chain(roads, one.direction, one.lane), one.per_hour, one.models, one.is_entering)
            for one in drafted.flows
        ]
        vehicles = build_flows(roads, flows, seed, egos)
    rsus = (site.rsu,) if drafted.has_rsu else ()
    return FamilyScene(roads, egos, vehicles, drafted.actors, rsus, signals=site.corridor is not None)


def _build_families(
    category: str, descriptions: tuple[str, str], parameters: tuple[FamilyParameter, ...], draft: Drafter
) -> tuple[ScenarioFamily, ScenarioFamily]:
    """Return the family on the road and the one in the corridor."""
    stage = partial(_stage, draft)
    return (
        ScenarioFamily(category, descriptions[0], parameters, stage),
        ScenarioFamily(f"corridor-{category}", descriptions[1], (SITE_PARAMETER, *parameters), stage),
    )


PLATOON_PARAMETERS = (
    FamilyParameter("eastward", 1.0, 5.0, "", "number of CAVs in the eastward platoon, rounded"),
    FamilyParameter("northward", 1.0, 5.0, "", "number of CAVs in the platoon on the minor road, rounded"),
    FamilyParameter("westward", 0.0, 5.0, "", "number of CAVs in the westward platoon, rounded"),
    FamilyParameter("arrival", 4.0, 6.0, "s", "time after which the eastward platoon is due at the crossing"),
    FamilyParameter("north_offset", -2.0, 2.0, "s", "how much later the platoon on the minor road is due"),
    FamilyParameter("west_offset", -3.0, 3.0, "s", "how much later the westward platoon is due"),
    FamilyParameter("east_speed", 16.0, 22.0, "m/s", "speed of the eastward and westward platoons"),
    FamilyParameter("north_speed", 14.0, 19.0, "m/s", "speed of the platoon on the minor road"),
    FamilyParameter("headway", 0.5, 1.6, "s", "time headway in platoons"),
    FamilyParameter("flow", 0.0, 900.0, "veh/h", "other traffic on each left lane of the priority road"),
)
MIXED_PARAMETERS = (
    FamilyParameter("northward", 2.0, 8.0, "", "number of CAVs on the minor road, rounded"),
    FamilyParameter("eastward", 0.0, 1.0, "", "number of CAVs in the eastward traffic, rounded"),
    FamilyParameter("westward", 0.0, 1.0, "", "number of CAVs in the westward traffic, rounded"),
    FamilyParameter("rsu", 0.0, 1.0, "", "whether there is a road-side unit (from 0.5 on, or without CAVs there)"),
    FamilyParameter("arrival", 4.0, 7.0, "s", "time after which the first CAV on the minor road is due"),
    FamilyParameter("main_offset", -1.5, 3.0, "s", "how much later the CAVs on the priority road are due"),
    FamilyParameter("speed", 16.0, 19.4, "m/s", "start speed of the CAVs that cross"),
    FamilyParameter("main_speed", 16.0, 21.0, "m/s", "start speed of the CAVs on the priority road"),
    FamilyParameter("headway", 0.8, 2.0, "s", "time headway of CAVs"),
    FamilyParameter("near_flow", 50.0, 600.0, "veh/h", "eastward traffic on each lane that is not connected"),
    FamilyParameter("far_flow", 50.0, 600.0, "veh/h", "westward traffic on each lane that is not connected"),
)
AMBULANCE_PARAMETERS = (
    FamilyParameter("eastward", 1.0, 5.0, "", "number of CAVs that drive east, rounded"),
    FamilyParameter("westward", 1.0, 5.0, "", "number of CAVs that drive west, rounded"),
    FamilyParameter("witnesses", 0.0, 1.0, "", "number of CAVs that see the ambulance, rounded"),
    FamilyParameter("rsu", 0.0, 1.0, "", "whether there is a road-side unit (from 0.5 on, or without witnesses)"),
    FamilyParameter("arrival", 5.0, 8.0, "s", "time after which the ambulance is due at the crossing"),
    FamilyParameter("ambulance_speed", 17.0, 25.0, "m/s", "speed of the ambulance"),
    FamilyParameter("east_offset", -1.5, 1.5, "s", "how much later the first eastward CAV is due"),
    FamilyParameter("west_offset", -1.5, 1.5, "s", "how much later the first westward CAV is due"),
    FamilyParameter("witness_offset", 1.5, 3.5, "s", "how much later the first witness is due"),
    FamilyParameter("speed", 16.0, 22.0, "m/s", "start speed of the CAVs on the priority road"),
    FamilyParameter("headway", 0.7, 1.5, "s", "time headway of CAVs"),
    FamilyParameter("flow", 0.0, 800.0, "veh/h", "other traffic that follows on three lanes of the priority road"),
)
WITNESS_SPEED = 11.0
"""[m/s] Start speed of the CAVs that see the ambulance."""


def _draft_platoons(values: Values, _roads: RoadMap, _site: CrossingRoads) -> CrossingDraft:
    ways = (
        ("eastward", 0, "eastward", values["east_speed"], 0.0),
        ("minor", 1, "northward", values["north_speed"], values["north_offset"]),
        ("westward", 0, "westward", values["east_speed"], values["west_offset"]),
    )
    platoons = [
        CrossingPlatoon(direction, lane, values[name], speed, values["arrival"] + offset, values["headway"])
        for direction, lane, name, speed, offset in ways
    ]
    flows = [CrossingFlow(direction, 1, values["flow"], CARS) for direction in ("eastward", "westward")]
    return CrossingDraft(platoons, flows)


def _draft_mixed_traffic(values: Values, _roads: RoadMap, _site: CrossingRoads) -> CrossingDraft:
    ways = (
        ("minor", 1, "northward", values["speed"], 0.0),
        ("eastward", 0, "eastward", values["main_speed"], values["main_offset"]),
        ("westward", 1, "westward", values["main_speed"], values["main_offset"]),
    )
    platoons = [
        CrossingPlatoon(direction, lane, values[name], speed, values["arrival"] + offset, values["headway"])
        for direction, lane, name, speed, offset in ways
    ]
    flows = [
        CrossingFlow(direction, k, values[name], CARS if k else MIXED)
        for direction, name in (("eastward", "near_flow"), ("westward", "far_flow"))
        for k in (0, 1)
    ]
    has_witness = any(round(values[name]) for name in ("eastward", "westward"))
    return CrossingDraft(platoons, flows, has_rsu=values["rsu"] >= 0.5 or not has_witness)


def _draft_ambulance(values: Values, roads: RoadMap, site: CrossingRoads) -> CrossingDraft:
    """An ambulance crosses without stopping; the corners hide it."""
    ways = (
        ("eastward", "eastward", values["speed"], values["east_offset"]),
        ("westward", "westward", values["speed"], values["west_offset"]),
        ("witness", "witnesses", WITNESS_SPEED, values["witness_offset"]),
    )
    speed = values["ambulance_speed"] * site.speed_factor
    lane = site.find_chain(roads, "minor", 1)  # nearest to the corner: hidden longest
    start_m = compute_lead(roads, lane, speed, values["arrival"])
    arrival_s = (compute_lead(roads, lane, 0.0, 0.0) - start_m) / speed
    platoons = [
        CrossingPlatoon(direction, 1, values[name], fast, arrival_s + offset, values["headway"])
        for direction, name, fast, offset in ways
    ]
    drive = (lane, start_m, speed)
    ambulance = build_driving_actor(roads, "ambulance", "ambulance", drive, avoid_collision=False)
    flows = [
        CrossingFlow(direction, k, values["flow"], CARS, is_entering=True)
        for direction, k in (("eastward", 0), ("eastward", 1), ("westward", 1))
    ]
    has_rsu = values["rsu"] >= 0.5 or not round(values["witnesses"])
    return CrossingDraft(platoons, flows, has_rsu, (ambulance,))


PLATOON_FAMILIES = _build_families(
    "platoon-crossing",
    (
        "Platoons of CAVs cross each other's way at 10 to 22 m/s; halls or houses at the corners hide them.",
        "Platoons of CAVs cross each other's way in a dense corridor; houses at the corners hide them.",
    ),
    PLATOON_PARAMETERS,
    _draft_platoons,
)
MIXED_FAMILIES = _build_families(
    "mixed-crossing",
    (
        "CAVs cross a priority road whose traffic of 14 to 20 m/s sends nothing, but for single CAVs in it.",
        "CAVs of a side street cross a dense corridor whose traffic sends nothing, but for single CAVs in it.",
    ),
    MIXED_PARAMETERS,
    _draft_mixed_traffic,
)
AMBULANCE_FAMILIES = _build_families(
    "emergency-vehicle",
    (
        "An ambulance on call crosses a priority road at 12 to 25 m/s and comes into view at the last moment.",
        "An ambulance on call crosses a dense corridor and comes into view at the last moment.",
    ),
    AMBULANCE_PARAMETERS,
    _draft_ambulance,
)
