"""Proposer of the InterDrive bucket: one function per category draws conflicts of CAVs without other traffic.

The categories and their numbers of CAVs are those of the packaged suite, whose 46 scenarios were made by hand.
"""

import random
from collections.abc import Callable, Mapping, Sequence

from mdrive_sumo.generate.category_requirements import find_requirements
from mdrive_sumo.generate.proposal import (
    Draft,
    Maneuver,
    Proposal,
    add_followers,
    draft_ego,
    draft_relation,
    relate_followers,
)
from mdrive_sumo.scenario.categories import InterDriveCategory
from mdrive_sumo.worlds.network_features import Topology

TURNS: Sequence[Maneuver] = ("left", "left", "straight", "right", "right")
"""CAVs of the original turn more than they go straight on: 65.85 deg on average."""
SIDES = ("perpendicular_right_of", "perpendicular_left_of")
CHANGING_SHARE = 0.75
"""Share of CAVs that change lanes where many do."""
BESIDE = ("left_lane_of", "right_lane_of")


def propose_interdrive(category: InterDriveCategory, cavs: int, topology: Topology, rng: random.Random) -> Proposal:
    """Return a proposal of the category with a number of CAVs within its range, on one of its topologies."""
    needs = find_requirements(category).road
    draft: Draft = {
        "category": category,
        "topology": topology,
        "needs_oncoming": needs.oncoming,
        "needs_multi_lane": needs.multi_lane,
        "needs_on_ramp": needs.on_ramp,
        "needs_merge": needs.merge,
    }
    return Proposal.model_validate(draft | TEMPLATES[category](cavs, rng))


def _queue(
    egos: Sequence[Draft],
    relations: Sequence[Draft],
    cavs: int,
    followed: Sequence[int],
    rng: random.Random,
    about: str,
) -> Draft:
    """Return a draft in which further CAVs follow some of the first ones: those that turn, if one does."""
    behind = relate_followers(len(egos) + 1, cavs, followed, rng)
    return {
        "ego_vehicles": add_followers(egos, behind, cavs),
        "vehicle_constraints": [*relations, *behind],
        "description": about,
    }


def _cut_in(cavs: int, rng: random.Random) -> Draft:
    turn: Maneuver = rng.choice(("left", "left", "right"))
    side = "left_lane_of" if turn == "left" else "right_lane_of"
    egos = [draft_ego(1, "lane_change", lane_change_phase="before_intersection"), draft_ego(2, turn)]
    relations = [draft_relation(2, side, 1), draft_relation(1, "merges_into_lane_of", 2)]
    return _queue(
        egos, relations, cavs, (1, 2), rng, f"CAV 0 cuts into the lane of CAV 1 before a junction; both turn {turn}."
    )


def _straight(cavs: int, rng: random.Random) -> Draft:
    relations = [draft_relation(2, rng.choice(SIDES), 1)]
    return _queue([draft_ego(1), draft_ego(2)], relations, cavs, (1, 2), rng, "CAVs cross straight on from two roads.")


def _left(cavs: int, rng: random.Random) -> Draft:
    relations = [draft_relation(2, rng.choice(SIDES), 1)]
    about = "A CAV turns left out of a cross street; CAV 0 goes straight on."
    return _queue([draft_ego(1), draft_ego(2, "left")], relations, cavs, (2,), rng, about)


def _right(cavs: int, rng: random.Random) -> Draft:
    relations = [draft_relation(2, "perpendicular_right_of", 1), draft_relation(2, "merges_into_lane_of", 1)]
    about = "A CAV turns right into the lane in which CAV 0 goes straight on."
    return _queue([draft_ego(1), draft_ego(2, "right")], relations, cavs, (2,), rng, about)


def _oncoming_left(cavs: int, rng: random.Random) -> Draft:
    relations = [draft_relation(2, "opposite_approach_of", 1)]
    about = "CAVs turn left against oncoming CAVs."
    draft = _queue([draft_ego(1, "left"), draft_ego(2)], relations, min(cavs, 3), (1,), rng, about)
    if cavs <= 3:
        return draft
    last: Maneuver = rng.choice(("straight", "left"))
    return draft | {
        "ego_vehicles": [*draft["ego_vehicles"], draft_ego(4, last)],
        "vehicle_constraints": [*draft["vehicle_constraints"], draft_relation(4, "same_approach_as", 2)],
    }


def _same_exit(cavs: int, rng: random.Random) -> Draft:
    relations = [draft_relation(2, "opposite_approach_of", 1), draft_relation(2, "merges_into_lane_of", 1)]
    about = "CAVs that turn right and oncoming ones that turn left want the same lane."
    return _queue([draft_ego(1, "right"), draft_ego(2, "left")], relations, cavs, (1, 2), rng, about)


def _swap(cavs: int, rng: random.Random) -> Draft:
    """The CAVs behind the pair that swaps turn off from the lanes in which they are."""
    egos = [draft_ego(n, "lane_change", lane_change_phase="before_intersection") for n in (1, 2)]
    behind: list[tuple[Maneuver, int]] = [("left", 2), ("right", 1)]
    rng.shuffle(behind)
    turning: list[tuple[int, Maneuver, int]] = [(n, turn, ahead) for n, (turn, ahead) in enumerate(behind, 3)]
    egos += [draft_ego(n, turn) for n, turn, _ in turning]
    relations = [draft_relation(n, "same_lane_as", ahead) for n, _, ahead in turning]
    return {
        "ego_vehicles": egos[:cavs],
        "vehicle_constraints": [draft_relation(2, "left_lane_of", 1), *relations][: cavs - 1],
        "description": "CAVs side by side swap lanes before a junction.",
    }


def _chaos(cavs: int, rng: random.Random) -> Draft:
    """CAVs from all four roads; those behind turn as they like."""
    relations = [draft_relation(n, side, 1) for n, side in enumerate((*SIDES, "opposite_approach_of"), 2)]
    relations += [draft_relation(n, "same_approach_as", 1 + (n - 5) % 4) for n in range(5, cavs + 1)]
    return {
        "ego_vehicles": [draft_ego(n, rng.choice(TURNS)) for n in range(1, cavs + 1)],
        "vehicle_constraints": relations,
        "description": f"{cavs} CAVs reach a crossing from all roads at once.",
    }


def _merge(cavs: int, rng: random.Random) -> Draft:
    egos = [draft_ego(1, "unknown", entry_road="side"), draft_ego(2, entry_road="main")]
    relations = [draft_relation(1, "merges_into_lane_of", 2)]
    behind = relate_followers(3, cavs, (1, 2, 2), rng)
    return {
        "ego_vehicles": add_followers(egos, behind, cavs),
        "vehicle_constraints": [*relations, *behind],
        "description": "A CAV comes from the ramp, where CAVs drive on the lane that it must join.",
    }


def _lane_changes(cavs: int, rng: random.Random) -> Draft:
    """Pairs side by side, most of which want each other's lanes; the pairs drive one behind the other."""
    egos: list[Draft] = []
    relations: list[Draft] = []
    for n in range(1, cavs + 1):
        changes = rng.random() < CHANGING_SHARE
        egos.append(draft_ego(n, "lane_change", lane_change_phase="before_intersection") if changes else draft_ego(n))
        if n == 2:
            relations.append(draft_relation(2, rng.choice(BESIDE), 1))
        elif n > 2:
            relations.append(draft_relation(n, rng.choice(("same_lane_as", *BESIDE)), rng.randrange(max(1, n - 3), n)))
    return {
        "ego_vehicles": egos,
        "vehicle_constraints": relations,
        "description": f"{cavs} CAVs side by side cross each other's ways.",
    }


TEMPLATES: Mapping[InterDriveCategory, Callable[[int, random.Random], Draft]] = {
    InterDriveCategory.CUT_IN: _cut_in,
    InterDriveCategory.STRAIGHT: _straight,
    InterDriveCategory.LEFT: _left,
    InterDriveCategory.RIGHT: _right,
    InterDriveCategory.ONCOMING_LEFT: _oncoming_left,
    InterDriveCategory.SAME_EXIT: _same_exit,
    InterDriveCategory.SWAP: _swap,
    InterDriveCategory.CHAOS: _chaos,
    InterDriveCategory.MERGE: _merge,
    InterDriveCategory.LANE_CHANGES: _lane_changes,
}
