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
"""Outside towns; heavy vehicles of 8 % as on German federal roads (BASt, automatic counts: 7 to 9 %)."""
MOTORWAY: Mapping[str, float] = MappingProxyType({"car": 0.74, "van": 0.10, "truck": 0.15, "motorcycle": 0.01})
"""Heavy vehicles of 15 % as on German motorways (BASt, automatic counts: 14 to 16 %)."""


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
    most_vehicles: int = 40
    """Background vehicles of a scenario at most: those nearest to the CAVs stay, and SUMO's time is bounded."""
    entry_s: float = 45.0
    """[s] Vehicles enter until then."""


_DEMANDS = (
    TrafficDemand(
        "town-quiet",
        "Residential streets: few vehicles, parked rows, people on foot.",
        flow_per_lane=120.0,  # RASt 06: residential streets carry up to 400 vehicles an hour in both directions
        queue_share=0.05,
        most_vehicles=24,
    ),
    TrafficDemand(
        "town-busy",
        "Shopping streets of a town: queues, buses, deliveries, cyclists, many people on foot.",
        flow_per_lane=450.0,  # RASt 06: local shopping streets carry 400 to 2 600 vehicles an hour in both directions
        queue_share=0.3,
    ),
    TrafficDemand(
        "old-town",
        "Narrow streets of an old town: slow, few vehicles, many people on foot.",
        flow_per_lane=150.0,  # RASt 06: neighbourhood streets carry 400 to 1 000 vehicles an hour; an old town: chosen
        queue_share=0.1,
        most_vehicles=24,
    ),
    TrafficDemand(
        "arterial",
        "Main roads of several lanes: dense traffic, long queues at signals.",
        flow_per_lane=600.0,  # RASt 06: connecting roads carry 800 to 2 600 vehicles an hour in both directions
        queue_share=0.4,
        longest_queue=8,
        most_vehicles=60,
    ),
    TrafficDemand(
        "country",
        "Roads outside towns.",
        flow_per_lane=220.0,  # BASt counts: federal roads carry about 9 000 vehicles a day; a day lasts 20 such hours
        classes=RURAL,
        queue_share=0.05,
        most_vehicles=30,
    ),
    TrafficDemand(
        "motorway",
        "Motorways: fast traffic with many trucks.",
        flow_per_lane=1000.0,  # BASt counts: 52 000 vehicles a day on about four lanes; 8 % of it in the peak hour
        classes=MOTORWAY,
        most_vehicles=60,
    ),
)
DEMANDS: Mapping[str, TrafficDemand] = MappingProxyType({demand.name: demand for demand in _DEMANDS})
"""The named demands."""


def find_demand(name: str) -> TrafficDemand:
    """Return a named demand. Raises InputError that lists the names."""
    if name not in DEMANDS:
        raise InputError(f"demand: {describe_unknown(name, DEMANDS)}")
    return DEMANDS[name]
