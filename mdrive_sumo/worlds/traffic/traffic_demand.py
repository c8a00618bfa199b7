"""How much traffic of what kind there is in a world: named demands, each number with its source or `chosen`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown

TURN_SHARES: Mapping[str, float] = MappingProxyType({"straight": 0.6, "left": 0.2, "right": 0.2})
"""Weights of the turns where a lane allows several: chosen, as the default shares of turning counts of SUMO's
`jtrrouter` are (30 % right, 50 % straight, 20 % left), for both sides of the road alike."""
URBAN: Mapping[str, float] = MappingProxyType(
    {"car": 0.80, "van": 0.11, "truck": 0.03, "bus": 0.02, "motorcycle": 0.03, "emergency": 0.01}
)
"""Weights of classes in a town: chosen; heavy vehicles of 3 to 5 % are usual on urban main roads."""
RURAL: Mapping[str, float] = MappingProxyType(
    {"car": 0.79, "van": 0.10, "truck": 0.08, "bus": 0.01, "motorcycle": 0.02}
)
"""Outside towns; heavy vehicles (trucks and buses) of 9 %: on German federal roads they are 800 of 9 440 vehicles a day
(BASt, automatic counts of 2012). The rest is chosen."""
MOTORWAY: Mapping[str, float] = MappingProxyType({"car": 0.74, "van": 0.10, "truck": 0.15, "motorcycle": 0.01})
"""Heavy vehicles of 15 %: on German motorways they are 7 010 of 47 100 vehicles a day (the same counts)."""


@dataclass(frozen=True, slots=True)
class TrafficDemand:
    """What road users a world holds. Rates are means; what is drawn differs by chance and by what has room."""

    name: str
    description: str
    flow_per_lane: float
    """Vehicles per hour and lane, at the start on the road and later at the entries."""
    classes: Mapping[str, float] = field(default_factory=lambda: URBAN)
    """Weights of the classes of `VEHICLE_CLASSES`."""
    turn_shares: Mapping[str, float] = field(default_factory=lambda: TURN_SHARES)
    queue_share: float = 0.0
    """Share of the lanes before junctions at which vehicles stand at the start."""
    longest_queue: int = 5
    """Vehicles of a queue: 1 to this, all alike."""
    bus_stop_share: float = 0.6
    """Share of the bus stops with a bus at the start or soon: chosen."""
    deliveries_per_km: float = 0.0
    """Vans that stand in the rightmost lane, per km of it."""
    cyclists_per_km: float = 0.0
    """Cyclists and e-scooters per km of cycle lane, or of street where there is none."""
    parked_share: float = 0.8
    """Share of parking places that are taken."""
    kerb_share: float = 0.0
    """Share of streets with vehicles at the kerb, in networks without parking rows."""
    pull_out_share: float = 0.0
    """Share of the vehicles at the front of a parked row that pull out."""
    door_share: float = 0.0
    """Share of the parked vehicles whose driver gets out soon."""
    walkers_per_km: float = 0.0
    """Groups of people per km of pavement."""
    group_share: float = 0.4
    """Share of groups that are more than one person."""
    crossers_per_zebra: float = 0.0
    """Groups of people who cross at a zebra crossing."""
    street_crossers_per_km: float = 0.0
    """Groups of people who cross elsewhere, per km of pavement."""
    fronts: float = 0.0
    """Schools and shops with people before them."""
    most_vehicles: int = 40
    """Background vehicles of a scenario at most: those nearest to the CAVs stay, and SUMO's time is bounded."""
    most_people: int = 36
    """People on foot at most: those nearest to the CAVs. 85 scripted road users take 0.7 ms a tick (docs/actors.md)."""
    most_parked: int = 60
    """Parked vehicles at most."""
    entry_s: float = 45.0
    """[s] Vehicles enter until then."""


_DEMANDS = (
    TrafficDemand(
        "town-quiet",
        "Residential streets: few vehicles, parked rows, children.",
        flow_per_lane=120.0,  # RASt 06: residential streets carry up to 400 vehicles an hour in both directions
        queue_share=0.05,
        deliveries_per_km=0.4,
        cyclists_per_km=4.0,  # 70 an hour at 4.8 m/s: chosen
        kerb_share=0.6,
        pull_out_share=0.25,
        door_share=0.05,
        walkers_per_km=12.0,  # 60 people an hour and pavement at 1.34 m/s: chosen
        crossers_per_zebra=0.5,
        street_crossers_per_km=2.0,
        fronts=0.6,
        most_vehicles=24,
    ),
    TrafficDemand(
        "town-busy",
        "Shopping streets of a town: queues, buses, deliveries, cyclists, many people on foot.",
        flow_per_lane=450.0,  # RASt 06: local shopping streets carry 400 to 2 600 vehicles an hour in both directions
        queue_share=0.3,
        deliveries_per_km=1.2,
        cyclists_per_km=10.0,  # 170 an hour at 4.8 m/s: chosen
        parked_share=0.9,
        kerb_share=0.3,
        pull_out_share=0.4,
        door_share=0.06,
        walkers_per_km=40.0,  # 200 groups an hour and pavement: chosen
        group_share=0.55,  # Moussaid et al. 2010: up to 70 % of the people in a shopping street are in groups
        crossers_per_zebra=1.6,
        street_crossers_per_km=3.0,
        fronts=1.5,
    ),
    TrafficDemand(
        "old-town",
        "Narrow streets of an old town: slow, few vehicles, many people on foot.",
        flow_per_lane=150.0,  # RASt 06: neighbourhood streets carry 400 to 1 000 vehicles an hour; an old town: chosen
        queue_share=0.1,
        deliveries_per_km=1.0,
        cyclists_per_km=8.0,
        parked_share=0.7,
        kerb_share=0.2,
        pull_out_share=0.3,
        door_share=0.05,
        walkers_per_km=50.0,
        group_share=0.55,
        crossers_per_zebra=1.0,
        street_crossers_per_km=6.0,
        fronts=1.2,
        most_vehicles=24,
    ),
    TrafficDemand(
        "arterial",
        "Main roads of several lanes: dense traffic, long queues at signals.",
        flow_per_lane=600.0,  # RASt 06: connecting roads carry 800 to 2 600 vehicles an hour in both directions
        queue_share=0.4,
        longest_queue=8,
        deliveries_per_km=0.5,
        cyclists_per_km=6.0,
        kerb_share=0.1,
        pull_out_share=0.2,
        door_share=0.03,
        walkers_per_km=15.0,
        crossers_per_zebra=1.0,
        street_crossers_per_km=0.5,
        fronts=0.4,
        most_vehicles=60,
    ),
    TrafficDemand(
        "country",
        "Roads outside towns.",
        # BASt, counts of 2012: 9 440 vehicles a day on a federal road of two lanes; a peak hour is 9 % of a day
        flow_per_lane=420.0,
        classes=RURAL,
        queue_share=0.05,
        cyclists_per_km=1.0,
        walkers_per_km=3.0,
        crossers_per_zebra=0.2,
        most_vehicles=30,
        most_people=8,
    ),
    TrafficDemand(
        "motorway",
        "Motorways: fast traffic with many trucks.",
        # BASt, counts of 2012: 47 100 vehicles a day on about four lanes; a peak hour is 9 % of a day
        flow_per_lane=1050.0,
        classes=MOTORWAY,
        most_vehicles=60,
        most_people=0,
        most_parked=0,
    ),
)
DEMANDS: Mapping[str, TrafficDemand] = MappingProxyType({demand.name: demand for demand in _DEMANDS})
"""The named demands."""


def find_demand(name: str) -> TrafficDemand:
    """Return a named demand. Raises InputError that lists the names."""
    if name not in DEMANDS:
        raise InputError(f"demand: {describe_unknown(name, DEMANDS)}")
    return DEMANDS[name]
