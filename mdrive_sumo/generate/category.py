"""Categories of the Interaction bucket: what each asks of a proposal, and the figures of the paper's table.

Paper, "Scenario Description" and table "MDrive-Interaction Subset Distribution"; protocol 1.2 and 14.1.
"""

from dataclasses import dataclass
from enum import StrEnum


class Category(StrEnum):
    """Interaction categories in the paper's order, and the lane drop, which its generator knows and its list lacks."""

    PRE_CRASH = "pre-crash"
    BLOCKED_LANE = "blocked-lane"
    CONSTRUCTION = "construction"
    HIGHWAY_MERGE = "highway-merge"
    LANE_CHANGE = "lane-change"
    DEADLOCK = "deadlock"
    MAJOR_MINOR = "major-minor"
    OVERTAKING = "overtaking"
    CROSSWALK = "crosswalk"
    ROUNDABOUT = "roundabout"
    UNPROTECTED_LEFT = "unprotected-left"
    LANE_DROP = "lane-drop"


class Level(StrEnum):
    """Interactivity levels of the paper."""

    STATIC = "static-avoidance"
    DYNAMIC = "dynamic-avoidance"
    COORDINATION = "dynamic-coordination"


class Topology(StrEnum):
    """Shapes of road that a proposal may ask for (protocol 14.1)."""

    INTERSECTION = "intersection"
    T_JUNCTION = "t_junction"
    CORRIDOR = "corridor"
    TWO_LANE_CORRIDOR = "two_lane_corridor"
    HIGHWAY = "highway"
    ROUNDABOUT = "roundabout"


@dataclass(frozen=True, slots=True)
class Figures:
    """Means of the paper's table over the scenarios of a category."""

    count: int
    cavs: float
    route_m: float
    heading_change_deg: float
    actors: float


@dataclass(frozen=True, slots=True)
class Needs:
    """What a category asks of topology and script (protocol 14.1, "Requirements per category")."""

    topologies: tuple[Topology, ...]
    oncoming: bool = False
    multi_lane: bool = False
    on_ramp: bool = False
    merge: bool = False


@dataclass(frozen=True, slots=True)
class CategoryFacts:
    """Everything that is fixed about a category."""

    title: str
    level: Level
    needs: Needs
    egos: tuple[int, int]
    """Least and most CAVs (protocol 14.1: 2 to 6 by category)."""
    paper: Figures | None
    """None: the paper lists no scenarios of it."""
    crops: tuple[str, ...] = ()
    """Networks on which templates stage it; any other that offers what it needs serves too."""


_ANY = (Topology.INTERSECTION, Topology.T_JUNCTION, Topology.CORRIDOR, Topology.TWO_LANE_CORRIDOR)
CATEGORIES: dict[Category, CategoryFacts] = {
    Category.PRE_CRASH: CategoryFacts(
        "Pre-crash", Level.COORDINATION, Needs(_ANY), (1, 3), Figures(12, 2.17, 42.6, 91.5, 1.25)
    ),
    Category.BLOCKED_LANE: CategoryFacts(
        "Blocked Lane Obstacle",
        Level.STATIC,
        Needs((Topology.CORRIDOR,), multi_lane=True),
        (3, 6),
        Figures(10, 4.7, 88.8, 6.5, 3.4),
        ("avenue",),
    ),
    Category.CONSTRUCTION: CategoryFacts(
        "Construction Zone",
        Level.STATIC,
        Needs((Topology.INTERSECTION,), multi_lane=True),
        (3, 6),
        Figures(10, 4.6, 95.5, 6.4, 7.1),
        ("market_crossing", "wide_crossing"),
    ),
    Category.HIGHWAY_MERGE: CategoryFacts(
        "Highway On-Ramp Merge",
        Level.COORDINATION,
        Needs((Topology.HIGHWAY,), multi_lane=True, on_ramp=True, merge=True),
        (3, 6),
        Figures(10, 4.6, 121.3, 18.5, 0.0),
        ("expressway", "freeway"),
    ),
    Category.LANE_CHANGE: CategoryFacts(
        "Interactive Lane Change",
        Level.COORDINATION,
        Needs((Topology.HIGHWAY,), multi_lane=True),
        (3, 6),
        Figures(10, 4.2, 100.9, 43.5, 0.0),
        ("expressway", "lane_drop", "motorway", "ramp_merge"),
    ),
    Category.DEADLOCK: CategoryFacts(
        "Intersection Deadlock Resolution",
        Level.COORDINATION,
        Needs((Topology.INTERSECTION,)),
        (4, 6),
        Figures(10, 4.7, 94.5, 89.7, 0.0),
        ("old_town", "quiet_crossing", "school_crossing", "town_crossing"),
    ),
    Category.MAJOR_MINOR: CategoryFacts(
        "Major / Minor Unsignalized Entry",
        Level.COORDINATION,
        Needs((Topology.T_JUNCTION,)),
        (3, 5),
        Figures(10, 4.0, 71.4, 34.0, 0.6),
        ("factory_gate", "minor_road", "side_street"),
    ),
    Category.OVERTAKING: CategoryFacts(
        "Overtaking on Two-Lane Road",
        Level.STATIC,
        Needs((Topology.TWO_LANE_CORRIDOR,), oncoming=True),
        (2, 5),
        Figures(10, 3.7, 63.0, 0.2, 2.1),
        ("country_road", "village_street"),
    ),
    Category.CROSSWALK: CategoryFacts(
        "Pedestrian Crosswalk",
        Level.DYNAMIC,
        Needs((Topology.INTERSECTION,)),
        (3, 5),
        Figures(10, 3.8, 92.5, 9.5, 2.7),
        ("market_crossing", "school_crossing"),
    ),
    Category.ROUNDABOUT: CategoryFacts(
        "Roundabout Navigation",
        Level.COORDINATION,
        Needs((Topology.ROUNDABOUT,)),
        (3, 5),
        Figures(10, 4.0, 112.1, 296.3, 0.0),
        ("large_roundabout", "roundabout"),
    ),
    Category.UNPROTECTED_LEFT: CategoryFacts(
        "Unprotected Left Turn",
        Level.COORDINATION,
        Needs((Topology.INTERSECTION,), oncoming=True),
        (4, 6),
        Figures(10, 5.1, 95.9, 40.2, 0.3),
        ("market_crossing", "quiet_crossing", "wide_crossing"),
    ),
    Category.LANE_DROP: CategoryFacts(
        "Lane Drop / Alternating Merge",
        Level.COORDINATION,
        Needs((Topology.HIGHWAY,), multi_lane=True, merge=True),
        (3, 6),
        None,
        ("lane_drop",),
    ),
}
