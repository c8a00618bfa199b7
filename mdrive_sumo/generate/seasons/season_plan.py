"""SeasonGroup: the categories of a season with their numbers of scenarios, and the means that each must have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from mdrive_sumo.generate.selection import Means
from mdrive_sumo.scenario.categories import FIGURES, Category, InterDriveCategory
from mdrive_sumo.scenario.statistics import PAPER

INTERDRIVE_COUNTS: Final = {
    InterDriveCategory.CUT_IN: {2: 6},
    InterDriveCategory.STRAIGHT: {2: 2, 3: 2},
    InterDriveCategory.LEFT: {2: 1, 3: 5},
    InterDriveCategory.RIGHT: {2: 1, 3: 5},
    InterDriveCategory.ONCOMING_LEFT: {3: 1, 4: 3},
    InterDriveCategory.SAME_EXIT: {3: 1, 4: 3},
    InterDriveCategory.SWAP: {3: 1, 4: 3},
    InterDriveCategory.CHAOS: {6: 1, 8: 3},
    InterDriveCategory.MERGE: {3: 1, 4: 3},
    InterDriveCategory.LANE_CHANGES: {6: 1, 7: 1, 8: 2},
}
"""Scenarios by category and number of CAVs: those of the packaged suite, 46 with 175 CAVs as in the original."""
SIGNAL_COUNTS: Final[Mapping[Category | InterDriveCategory, int]] = {
    InterDriveCategory.CUT_IN: 1,
    InterDriveCategory.ONCOMING_LEFT: 1,
    InterDriveCategory.SAME_EXIT: 1,
    InterDriveCategory.SWAP: 1,
    Category.UNPROTECTED_LEFT: 4,
    Category.CONSTRUCTION: 3,
    Category.CROSSWALK: 2,
    Category.PRE_CRASH: 1,
}
"""Scenarios at signals that run, of those of the category (of InterDrive: with the most CAVs); the others have none.

Chosen: 4 of 46 and 10 of 112, in the categories in which CAVs with green still meet (lefts through oncoming traffic,
lane changes before the line, people behind the junction). Season 0 has 1 of 46 (a swap) and 0 of 112."""
LEAST_HIDDEN: Final = 15
"""Scenarios of InterDrive with an occlusion certificate: `validate` asks for 15 of 46."""
TOWARDS_BUCKET: Final = 1.018
"""Factor on routes of Interaction: the paper's figure of the bucket (91.3 m) is not the mean of its own table of
categories (88.1 m; protocol 1.1). With this factor both are met within tolerance. Pre-crash
scenarios have none: their routes are 3 % above the table's already. Heading changes need none: those of rings and lane
changes stay a little below the table's, and so does the bucket's (55.4 deg; table 58.4)."""
OCCLUSION_CATEGORIES: Final = frozenset((Category.PRE_CRASH, Category.CROSSWALK))
"""Categories in which only scenarios with an occlusion certificate are kept."""
POOL_FACTORS: Final = {"interdrive": 10, "interaction": 5}
"""Scenarios in the pool per scenario that is kept. InterDrive's means are those of all its groups."""

CATEGORY_POOL_FACTORS: Final[Mapping[str, int]] = {
    Category.ROUNDABOUT: 8,
    Category.LANE_CHANGE: 10,
    Category.PRE_CRASH: 10,
}
"""On drawn rings CAVs turn by 230 deg on average, the paper's by 296; of lane changes by 25 deg, the paper's by 43: the
selection takes the upper part. Before a junction drawn for it, a pre-crash scenario has routes of 47 m, the paper's of
43 m: the selection takes the lower part."""


@dataclass(frozen=True, slots=True)
class SeasonGroup:
    """Scenarios of one category (of InterDrive: with one number of CAVs) that are searched together."""

    bucket: str
    category: Category | InterDriveCategory
    count: int
    cavs: int = 0
    """0: as the proposal draws it."""
    at_signals: bool = False
    """Whether its places have signals, which run."""

    @property
    def name(self) -> str:
        """Return the name of the group within its season."""
        return "-".join((str(self.category), *(str(self.cavs),) * bool(self.cavs), *("signals",) * self.at_signals))

    @property
    def pool_size(self) -> int:
        """Return the number of valid scenarios among which the group's are selected."""
        return CATEGORY_POOL_FACTORS.get(self.category, POOL_FACTORS[self.bucket]) * self.count

    @property
    def must_be_occluded(self) -> bool:
        """Return whether only scenarios with an occlusion certificate count."""
        return self.category in OCCLUSION_CATEGORIES


@dataclass(frozen=True, slots=True)
class Selection:
    """Groups whose scenarios together have some means."""

    name: str
    groups: tuple[SeasonGroup, ...]
    means: Means
    least_hidden: int = 0
    """Number of scenarios that shall have an occlusion certificate."""


def list_selections(bucket: str, per_group: int | None = None) -> Sequence[Selection]:
    """Return what a bucket is selected by: InterDrive as a whole, Interaction category by category.

    per_group: at most so many scenarios of each group, for a small season.
    """
    if bucket == "interdrive":
        paper = PAPER["interdrive"]
        groups = tuple(
            group
            for category, counts in INTERDRIVE_COUNTS.items()
            for cavs, count in counts.items()
            for group in _divide(
                SeasonGroup(bucket, category, count, cavs),
                SIGNAL_COUNTS.get(category, 0) if cavs == max(counts) else 0,
            )
        )
        found = [
            Selection(bucket, groups, (None, paper.mean_route_m, paper.mean_heading_change_deg, None), LEAST_HIDDEN)
        ]
    else:
        found = [
            Selection(
                str(category),
                _divide(SeasonGroup(bucket, category, figures.count), SIGNAL_COUNTS.get(category, 0)),
                (
                    figures.cavs,
                    figures.route_m * (1.0 if category is Category.PRE_CRASH else TOWARDS_BUCKET),
                    figures.heading_change_deg,
                    figures.actors,
                ),
            )
            for category, figures in FIGURES.items()
        ]
    return [replace(one, groups=tuple(_limit(group, per_group) for group in one.groups)) for one in found]


def _divide(group: SeasonGroup, at_signals: int) -> tuple[SeasonGroup, ...]:
    """Return a group without signals, and one with so many of its scenarios at signals."""
    if not at_signals:
        return (group,)
    return replace(group, count=group.count - at_signals), replace(group, count=at_signals, at_signals=True)


def _limit(group: SeasonGroup, per_group: int | None) -> SeasonGroup:
    return group if per_group is None else replace(group, count=min(group.count, per_group))
