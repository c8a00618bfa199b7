"""Crossings of a minor road with a priority road: a one-way street and a dual carriageway, or in a dense corridor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mdrive_sumo.generate.hard.family import FamilyParameter
from mdrive_sumo.generate.hard.family_streets import CORRIDORS, Corridor
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit
from mdrive_sumo.worlds.placement.cavs import Platoon
from mdrive_sumo.worlds.placement.lane_chains import Lanes, find_lane_start
from mdrive_sumo.worlds.streams.edge_streams import build_traffic
from mdrive_sumo.worlds.streams.lane_flows import TrafficFlow, build_flows

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


def find_site(values: Mapping[str, float]) -> CrossingRoads:
    """Return the crossing of the corridor that the parameter `site` means; without it that of the one-way street."""
    if SITE_PARAMETER.name not in values:
        return ONE_WAY
    return CORRIDOR_SITES[min(int(values[SITE_PARAMETER.name]), len(CORRIDOR_SITES) - 1)]


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


def build_crossing_traffic(
    roads: RoadMap, site: CrossingRoads, flows: Sequence[CrossingFlow], seed: str, egos: Sequence[Ego]
) -> tuple[BackgroundVehicle, ...]:
    """Return the reactive vehicles: the flows of a road, or as dense traffic in all streets of a corridor."""
    if site.corridor is not None:
        count = round(VEHICLES_PER_FLOW * sum(flow.per_hour for flow in flows))
        return build_traffic(roads, site.corridor.all_streams, count, seed, egos)
    made = [
        TrafficFlow(site.find_chain(roads, f.direction, f.lane), f.per_hour, f.models, f.is_entering) for f in flows
    ]
    return build_flows(roads, made, seed, egos)
