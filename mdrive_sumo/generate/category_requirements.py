"""Categories of the Interaction bucket and what each requires of a proposal (paper, "Scenario Description"; protocol
14.1)."""

from dataclasses import dataclass

from mdrive_sumo.scenario.categories import FIGURES, Category, CategoryFigures, InterDriveCategory
from mdrive_sumo.worlds.network_features import Topology


@dataclass(frozen=True, slots=True)
class RoadRequirements:
    """Requirements of a category on topology and road (protocol 14.1, "Requirements per category")."""

    topologies: tuple[Topology, ...]
    oncoming: bool = False
    multi_lane: bool = False
    on_ramp: bool = False
    merge: bool = False


@dataclass(frozen=True, slots=True)
class CategoryRequirements:
    """Fixed properties of a category."""

    title: str
    description: str
    """One sentence for a language model (paper, "Scenario Description", in our words; the lane drop: protocol 14.1)."""
    road: RoadRequirements
    cav_range: tuple[int, int]
    """Least and largest number of CAVs (protocol 14.1: 2 to 6 by category)."""
    paper: CategoryFigures | None
    """None: the paper lists no scenarios of the category."""
    networks: tuple[str, ...] = ()
    """Networks that the templates use; any other one that meets the requirements works too."""


_ANY = (Topology.INTERSECTION, Topology.T_JUNCTION, Topology.CORRIDOR, Topology.TWO_LANE_CORRIDOR)
CATEGORIES: dict[Category, CategoryRequirements] = {
    Category.PRE_CRASH: CategoryRequirements(
        "Pre-crash",
        (
            "A situation that precedes many real crashes, by NHTSA's typology: a road user is hidden"
            " from another, sees too little, or does something dangerous."
        ),
        RoadRequirements(_ANY),
        (1, 3),
        FIGURES[Category.PRE_CRASH],
    ),
    Category.BLOCKED_LANE: CategoryRequirements(
        "Blocked Lane Obstacle",
        "Things that stand still block the lane in which CAVs drive; they have to get past.",
        RoadRequirements((Topology.CORRIDOR,), multi_lane=True),
        (3, 6),
        FIGURES[Category.BLOCKED_LANE],
        ("avenue", "crescent"),
    ),
    Category.CONSTRUCTION: CategoryRequirements(
        "Construction Zone",
        "A work zone of cones and barriers narrows the road near a crossing.",
        RoadRequirements((Topology.INTERSECTION,), multi_lane=True),
        (3, 6),
        FIGURES[Category.CONSTRUCTION],
        ("market_crossing", "wide_crossing"),
    ),
    Category.HIGHWAY_MERGE: CategoryRequirements(
        "Highway On-Ramp Merge",
        "CAVs come from a ramp onto a highway on which other CAVs drive.",
        RoadRequirements((Topology.HIGHWAY,), multi_lane=True, on_ramp=True, merge=True),
        (3, 6),
        FIGURES[Category.HIGHWAY_MERGE],
        ("expressway", "freeway"),
    ),
    Category.LANE_CHANGE: CategoryRequirements(
        "Interactive Lane Change",
        "CAVs on several lanes weave into one another's lanes.",
        RoadRequirements((Topology.HIGHWAY,), multi_lane=True),
        (3, 6),
        FIGURES[Category.LANE_CHANGE],
        ("expressway", "lane_drop", "motorway", "ramp_merge"),
    ),
    Category.DEADLOCK: CategoryRequirements(
        "Intersection Deadlock Resolution",
        "Several CAVs reach a crossing without signals at once, and it is unclear who goes first.",
        RoadRequirements((Topology.INTERSECTION,)),
        (4, 6),
        FIGURES[Category.DEADLOCK],
        ("old_town", "quiet_crossing", "school_crossing", "town_crossing"),
    ),
    Category.MAJOR_MINOR: CategoryRequirements(
        "Major / Minor Unsignalized Entry",
        "A CAV comes out of a minor road into a major one at a T-junction without signals.",
        RoadRequirements((Topology.T_JUNCTION,)),
        (3, 5),
        FIGURES[Category.MAJOR_MINOR],
        ("factory_gate", "minor_road", "side_street"),
    ),
    Category.OVERTAKING: CategoryRequirements(
        "Overtaking on Two-Lane Road",
        (
            "On a road with one lane each way a CAV has to pass what stands in its lane while another CAV"
            " comes towards it."
        ),
        RoadRequirements((Topology.TWO_LANE_CORRIDOR,), oncoming=True),
        (2, 5),
        FIGURES[Category.OVERTAKING],
        ("country_road", "village_street"),
    ),
    Category.CROSSWALK: CategoryRequirements(
        "Pedestrian Crosswalk",
        "People on foot cross the ways of the CAVs.",
        RoadRequirements((Topology.INTERSECTION,)),
        (3, 5),
        FIGURES[Category.CROSSWALK],
        ("market_crossing", "school_crossing"),
    ),
    Category.ROUNDABOUT: CategoryRequirements(
        "Roundabout Navigation",
        "CAVs yield at a roundabout, merge into it, go round and leave it.",
        RoadRequirements((Topology.ROUNDABOUT,)),
        (3, 5),
        FIGURES[Category.ROUNDABOUT],
        ("large_roundabout", "roundabout"),
    ),
    Category.UNPROTECTED_LEFT: CategoryRequirements(
        "Unprotected Left Turn",
        "CAVs turn left through oncoming CAVs, with no signal that protects them.",
        RoadRequirements((Topology.INTERSECTION,), oncoming=True),
        (4, 6),
        FIGURES[Category.UNPROTECTED_LEFT],
        ("market_crossing", "quiet_crossing", "wide_crossing"),
    ),
    Category.LANE_DROP: CategoryRequirements(
        "Lane Drop / Alternating Merge",
        "A lane ends, and the CAVs of two lanes have to take turns.",
        RoadRequirements((Topology.HIGHWAY,), multi_lane=True, merge=True),
        (3, 6),
        None,
        ("lane_drop",),
    ),
}

_CROSSINGS = (Topology.INTERSECTION, Topology.T_JUNCTION)
INTERDRIVE: dict[InterDriveCategory, CategoryRequirements] = {
    name: CategoryRequirements(title, description, road, cav_range, None)
    for name, title, description, road, cav_range in (
        (
            InterDriveCategory.CUT_IN,
            "Same Lane at a Junction",
            "Side by side before a junction, one CAV changes into the lane of the other.",
            RoadRequirements(_CROSSINGS, multi_lane=True),
            (2, 2),
        ),
        (
            InterDriveCategory.STRAIGHT,
            "Straight against Straight",
            "CAVs cross a junction straight on from two roads.",
            RoadRequirements((Topology.INTERSECTION,)),
            (2, 4),
        ),
        (
            InterDriveCategory.LEFT,
            "Straight against Left",
            "A CAV turns left out of a cross street before CAVs that go straight on.",
            RoadRequirements(_CROSSINGS),
            (2, 4),
        ),
        (
            InterDriveCategory.RIGHT,
            "Straight against Right",
            "A CAV turns right into the lane of CAVs that go straight on.",
            RoadRequirements(_CROSSINGS),
            (2, 4),
        ),
        (
            InterDriveCategory.ONCOMING_LEFT,
            "Left against Oncoming",
            "CAVs turn left through oncoming CAVs.",
            RoadRequirements(_CROSSINGS, oncoming=True),
            (2, 4),
        ),
        (
            InterDriveCategory.SAME_EXIT,
            "Right and Left into One Lane",
            "CAVs that turn right and oncoming ones that turn left want the same lane.",
            RoadRequirements(_CROSSINGS, oncoming=True),
            (2, 4),
        ),
        (
            InterDriveCategory.SWAP,
            "Lane Swap before a Junction",
            "CAVs side by side swap lanes before they turn apart.",
            RoadRequirements(_CROSSINGS, multi_lane=True),
            (2, 4),
        ),
        (
            InterDriveCategory.CHAOS,
            "All from Everywhere",
            "CAVs from all roads reach a junction at once.",
            RoadRequirements((Topology.INTERSECTION,)),
            (6, 8),
        ),
        (
            InterDriveCategory.MERGE,
            "Ramp into a Row",
            "CAVs from a ramp join CAVs on the motorway.",
            RoadRequirements((Topology.HIGHWAY,), multi_lane=True, on_ramp=True, merge=True),
            (2, 4),
        ),
        (
            InterDriveCategory.LANE_CHANGES,
            "Many Lane Changes",
            "On a motorway CAVs side by side cross each other's ways.",
            RoadRequirements((Topology.HIGHWAY,), multi_lane=True),
            (6, 8),
        ),
    )
}
"""Of the InterDrive bucket; names and contents follow the packaged suite (`interdrive`, season 0)."""


INTERDRIVE_ROUTE_M: dict[InterDriveCategory, float] = {
    InterDriveCategory.CUT_IN: 60.0,
    InterDriveCategory.STRAIGHT: 49.0,
    InterDriveCategory.LEFT: 54.0,
    InterDriveCategory.RIGHT: 56.0,
    InterDriveCategory.ONCOMING_LEFT: 52.0,
    InterDriveCategory.SAME_EXIT: 54.0,
    InterDriveCategory.SWAP: 64.0,
    InterDriveCategory.CHAOS: 48.0,
    InterDriveCategory.MERGE: 60.0,
    InterDriveCategory.LANE_CHANGES: 47.0,
}
"""[m] Mean routes by category in the packaged suite, whose mean is that of the original (51.83 m)."""


def find_requirements(category: Category | InterDriveCategory) -> CategoryRequirements:
    """Return the fixed properties of a category of either bucket."""
    return INTERDRIVE[category] if isinstance(category, InterDriveCategory) else CATEGORIES[category]
