"""Fields of proposals before they are checked: CAVs, relations, and queues behind the first CAVs."""

import random
from collections.abc import Sequence
from typing import Any

from mdrive_sumo.generate.proposal import Maneuver

Draft = dict[str, Any]
"""Fields of a proposal or of a part of one."""


def draft_ego(number: int, maneuver: Maneuver = "straight", **more: str) -> Draft:
    """Return the fields of a CAV."""
    return {"vehicle_id": f"Vehicle {number}", "maneuver": maneuver, **more}


def draft_relation(a: int, type_: str, b: int) -> Draft:
    """Return the relation in which vehicle `a` stands to vehicle `b`."""
    return {"type": type_, "a": f"Vehicle {a}", "b": f"Vehicle {b}"}


def relate_followers(first: int, count: int, behind: Sequence[int], rng: random.Random) -> list[Draft]:
    """Return relations that put further CAVs behind the first ones."""
    return [draft_relation(n, "follow_route_of", rng.choice(list(behind))) for n in range(first, count + 1)]


def add_followers(egos: Sequence[Draft], relations: Sequence[Draft], count: int) -> list[Draft]:
    """Add CAVs that do what the CAV ahead of them does."""
    found = list(egos)
    for relation in relations:
        leader = next(ego for ego in found if ego["vehicle_id"] == relation["b"])
        found.append(leader | {"vehicle_id": relation["a"]})
    return found[:count]
