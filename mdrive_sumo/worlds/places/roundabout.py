"""Kind of place: a roundabout with one or two lanes and 3 to 5 arms."""

import math
import random
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.worlds.places.building_rows import add_surroundings
from mdrive_sumo.worlds.places.junction_rules import NUMBER_WORDS
from mdrive_sumo.worlds.places.junctions import build_roundabout
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import Drawn, between, choose
from mdrive_sumo.worlds.places.surroundings import SURROUNDINGS

AREAS = ("town", "suburb", "commercial", "country", "open")
SPREAD_DEG = 11.0
"""[deg] Largest deviation of an arm from even angles; with five arms and a small ring it is less."""
SEGMENT_M = 8.0
"""[m] Least length of the ring between the exit of an arm and the entry of the next (found with netconvert)."""
HALF_ARM_DEG = 19.0
"""[deg] Half of the angle that an arm takes of the ring (`build_roundabout`)."""
SIGHT_M = 9.0
"""[m] Kept free around the ring: drivers at an entry see the one before it and the ring in between (RASt 06, 6.3.5)."""
ISLAND_M = 3.0
"""[m] Between the lanes of the ring and what is planted on its island: an apron of 2 m and a margin (chosen)."""
ARM_M = (85.0, 115.0)
"""[m] Range of the length of arms; chosen."""
BEND_M = (70.0, 200.0)
"""[m] Range of radii of arms with a bend."""


def _weigh_lanes(drawn: Drawn) -> tuple[float, ...]:
    """Return the weights of one and two lanes: two are rare in German towns, where cyclists ride on the ring."""
    return (0.5, 0.5) if drawn["area"] == "commercial" else (0.9, 0.1)


def _weigh_speeds(drawn: Drawn) -> tuple[float, ...]:
    return {"country": (0.0, 0.3, 0.7), "suburb": (0.5, 0.5, 0.0)}.get(drawn["area"], (0.1, 0.9, 0.0))


def _limit_radius(drawn: Drawn) -> tuple[float, float]:
    """Return the range of the ring's radius [m]: small roundabouts of RASt 06 have 26 to 40 m in outer diameter."""
    least = {3: 14.0, 4: 15.0, 5: 20.0}[drawn["arms"]] if drawn["lanes"] == 1 else 24.0
    return least, least + 8.0


@dataclass(frozen=True)
class RoundaboutParameters:
    """Parameters of a roundabout."""

    area: str = choose(*AREAS, doc="Kind of neighbourhood.", weights=(1.0, 1.0, 1.0, 1.0, 0.0))
    arms: int = choose(3, 4, 5, doc="Streets that meet.", weights=(3.0, 6.0, 1.0))
    lanes: int = choose(1, 2, doc="Lanes of the ring and of each arm.", weights=_weigh_lanes)
    speed_kmh: int = choose(30, 50, 70, doc="Speed limit of the arms [km/h].", weights=_weigh_speeds)
    radius_m: float = between(14.0, 32.0, doc="From the middle to the ring's centre line [m].", limit=_limit_radius)
    bend: float = between(0.0, 0.8, doc="Share of arms with a bend.")
    planted: bool = choose(True, False, doc="Whether drivers cannot see across the island.")


def draw_roundabout(draft: NetworkDraft, parameters: RoundaboutParameters, rng: random.Random) -> None:
    """Fill a draft with a roundabout."""
    surroundings = SURROUNDINGS[parameters.area]
    lanes = "one lane" if parameters.lanes == 1 else "two lanes"
    draft.description = (
        f"a roundabout of {lanes} with {NUMBER_WORDS[parameters.arms]} arms {surroundings.words},"
        f" {parameters.speed_kmh} km/h; {'its island hides traffic' if parameters.planted else 'its island is flat'}"
    )
    bends = [_draw_bend(parameters.bend, rng) for _ in range(parameters.arms)]
    build_roundabout(
        draft,
        parameters.radius_m,
        parameters.lanes,
        _draw_angles(parameters, rng),
        rng.uniform(*ARM_M),
        bends,
        round(parameters.speed_kmh / 3.6, 2),
    )
    draft.yields += [f"arm_{k + 1}_in" for k in range(parameters.arms)]
    outer_m = parameters.radius_m + parameters.lanes * draft.lane_m / 2
    add_surroundings(draft, surroundings, [shapely.Point(0.0, 0.0).buffer(outer_m + SIGHT_M)], rng)
    if parameters.planted:
        inner_m = parameters.radius_m - parameters.lanes * draft.lane_m / 2 - ISLAND_M
        cos, sin = portable.cos_sin(np.arange(12) * (math.pi / 6))
        draft.obstacles.append(("planting", inner_m * np.stack((cos, sin), 1)))


def _draw_angles(parameters: RoundaboutParameters, rng: random.Random) -> list[float]:
    """Return the directions of the arms [deg], between 0 and 360 deg after the first."""
    even = 360.0 / parameters.arms
    free_deg = even - 2 * HALF_ARM_DEG - math.degrees(SEGMENT_M / parameters.radius_m)
    spread = min(SPREAD_DEG, max(free_deg, 0.0) / 2)
    first = rng.uniform(0.0, 360.0)
    return [first + k * even + rng.uniform(-spread, spread) for k in range(parameters.arms)]


def _draw_bend(share: float, rng: random.Random) -> float:
    """Return the curvature [1/m] of an arm."""
    radius_m, sign = rng.uniform(*BEND_M), rng.choice((-1.0, 1.0))
    return sign / radius_m if rng.random() < share else 0.0


ROUNDABOUT = PlaceKind(
    "roundabout", "a roundabout of one or two lanes with 3 to 5 arms", RoundaboutParameters, draw_roundabout
)
