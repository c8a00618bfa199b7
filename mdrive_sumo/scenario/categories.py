"""Categories of the Interaction bucket with the figures of the paper's table, and the deviation of means from them.

Paper, "Scenario Description" and table "MDrive-Interaction Subset Distribution"; protocol 1.2.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from mdrive_sumo.scenario.weather import WeatherName


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


class InterDriveCategory(StrEnum):
    """Categories of the InterDrive bucket, by the names of the original's folders (CoLMDriver; protocol 8.5)."""

    CUT_IN = "ins_c"
    STRAIGHT = "ins_ss"
    LEFT = "ins_sl"
    RIGHT = "ins_sr"
    ONCOMING_LEFT = "ins_oppo"
    SAME_EXIT = "ins_rl"
    SWAP = "ins_crosschange"
    CHAOS = "ins_chaos"
    MERGE = "hw_merge"
    LANE_CHANGES = "hw_c"


class InteractivityLevel(StrEnum):
    """Interactivity levels of the paper."""

    STATIC = "static-avoidance"
    DYNAMIC = "dynamic-avoidance"
    COORDINATION = "dynamic-coordination"


LEVELS: Mapping[Category, InteractivityLevel] = dict.fromkeys(Category, InteractivityLevel.COORDINATION) | {
    Category.BLOCKED_LANE: InteractivityLevel.STATIC,
    Category.CONSTRUCTION: InteractivityLevel.STATIC,
    Category.OVERTAKING: InteractivityLevel.STATIC,
    Category.CROSSWALK: InteractivityLevel.DYNAMIC,
}
"""Which level a category belongs to (protocol 1.2); of the lane drop our own choice."""


@dataclass(frozen=True, slots=True)
class CategoryFigures:
    """Means of the paper's table over the scenarios of a category."""

    count: int
    cavs: float
    route_m: float
    heading_change_deg: float
    actors: float

    @property
    def means(self) -> tuple[float, float, float, float]:
        """In the order of `MEANS`."""
        return self.cavs, self.route_m, self.heading_change_deg, self.actors


FIGURES: Mapping[Category, CategoryFigures] = {
    Category.PRE_CRASH: CategoryFigures(12, 2.17, 42.6, 91.5, 1.25),
    Category.BLOCKED_LANE: CategoryFigures(10, 4.7, 88.8, 6.5, 3.4),
    Category.CONSTRUCTION: CategoryFigures(10, 4.6, 95.5, 6.4, 7.1),
    Category.HIGHWAY_MERGE: CategoryFigures(10, 4.6, 121.3, 18.5, 0.0),
    Category.LANE_CHANGE: CategoryFigures(10, 4.2, 100.9, 43.5, 0.0),
    Category.DEADLOCK: CategoryFigures(10, 4.7, 94.5, 89.7, 0.0),
    Category.MAJOR_MINOR: CategoryFigures(10, 4.0, 71.4, 34.0, 0.6),
    Category.OVERTAKING: CategoryFigures(10, 3.7, 63.0, 0.2, 2.1),
    Category.CROSSWALK: CategoryFigures(10, 3.8, 92.5, 9.5, 2.7),
    Category.ROUNDABOUT: CategoryFigures(10, 4.0, 112.1, 296.3, 0.0),
    Category.UNPROTECTED_LEFT: CategoryFigures(10, 5.1, 95.9, 40.2, 0.3),
}
"""The paper lists no lane drops."""
MEANS = ("CAVs", "route [m]", "heading change [deg]", "actors")
FLOOR = (1.0, 10.0, 10.0, 1.0)
"""Means below these are compared as differences in these units: 0.2 degrees cannot be met within 10 %."""
WEATHER_OF_TEN: Mapping[WeatherName, int] = {"cloudy": 3, "night": 3, "default": 2, "rain": 2}
"""Of every ten scenarios of a category (paper, "Scenario Description")."""


def compute_deviations(found: Sequence[float], wanted: Sequence[float]) -> Iterator[float]:
    """Yield the relative differences between found and wanted means, in the order of `MEANS`, at least per `FLOOR`."""
    for mean, aim, floor in zip(found, wanted, FLOOR, strict=True):
        yield (mean - aim) / max(aim, floor)
