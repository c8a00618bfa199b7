"""Families where CAVs of all four streets of a crossing wait for one pause of hidden riders, and meet in it.

Each has the next one at its right, so none goes first by rule: CAVs that only see each other hesitate, lose the pause
and are late, or meet. With an agreed order they all pass.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache, partial
from itertools import combinations, groupby, product

import shapely

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values
from mdrive_sumo.generate.hard.junction_parameters import SITE, name_number
from mdrive_sumo.generate.hard.junction_users import CavColumn, build_columns
from mdrive_sumo.generate.hard.riders import (
    DELIVERING,
    PARKED,
    PEDELEC_MPS,
    SCOOTER_MPS,
    RiderCrossing,
    RiderKind,
    build_hidden_riders,
    build_rider_mast,
    find_rider_crossing,
)
from mdrive_sumo.generate.hard.sites.crossroads import are_opposite
from mdrive_sumo.generate.hard.sites.junction_conflicts import choose_site, refuse_place
from mdrive_sumo.generate.hard.sites.rider_sites import RiderSite, find_crossing_sites
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.placement.lane_chains import build_route_line

ARMS = 4
"""Streets of a crossing: CAVs come from each."""
SHIFTS = 16
"""Parts of the time between two riders by which the streams are shifted: at corners they pass through each other."""
DIGITS = 6
"""Of the times [s] by which shifts are compared: of equally good ones every machine takes the first."""
CONTROLS: tuple[JunctionKind, ...] = ("right-before-left", "priority-road", "yield", "stop")
"""Of the streets: at all-way stops CAVs come one after the other, so there is little to agree on."""

FourSites = tuple[RiderSite, ...]
"""One for each approach of a crossing."""


@lru_cache(maxsize=128)
def find_four_sites(roads: RoadMap) -> tuple[FourSites, ...]:
    """Return the crossings of four streets of one lane, by the sites at which riders cross each of them: each crossing
    twice, first with those of one street before those of the other."""
    sites = sorted(find_crossing_sites(roads, CONTROLS, beside_lane=False), key=lambda one: one.way.junction)
    crossings = [tuple(group) for _, group in groupby(sites, key=lambda one: one.way.junction)]
    return tuple(
        (*ahead, *(one for one in crossing if one not in ahead))
        for crossing in crossings
        if len(crossing) == ARMS
        for ahead in _list_streets(roads, crossing)
        if len(ahead) == ARMS // 2
    )


def _list_streets(roads: RoadMap, crossing: FourSites) -> Iterator[FourSites]:
    """Yield the sites of each of the two streets that cross."""
    first = tuple(one for one in crossing if one is crossing[0] or are_opposite(roads, one.way, crossing[0].way))
    yield first
    yield tuple(one for one in crossing if one not in first)


def stage_four_streets(kind: RiderKind, values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that drive straight on from all streets of a crossing, each across a stream of riders before it."""
    crossings_of_place = find_four_sites(roads)
    if not crossings_of_place:
        raise refuse_place(roads, "a crossing of four streets of one lane")
    sites = choose_site(crossings_of_place, values["site"])
    crossings = [find_rider_crossing(roads, site, values) for site in sites]
    lines = shapely.MultiLineString([crossing.strip.line for crossing in crossings])
    shifts = find_shifts(roads, crossings, values["riding"], values["every_s"])
    actors = [
        actor
        for k, (crossing, later_s) in enumerate(zip(crossings, shifts, strict=True))
        for actor in build_hidden_riders(roads, kind, crossing, values, (seed, k, lines), later_s)
    ]
    masts = tuple(build_rider_mast(roads, crossing, k) for k, crossing in enumerate(crossings))
    columns = [
        CavColumn(one.way.lanes, one.own_m, round(values[name]), values["due_s"], values["headway_s"])
        for one, name in zip(crossings, ("own", "own", "across", "across"), strict=True)
    ]
    return FamilyScene(build_columns(roads, columns), (), tuple(actors), masts)


def find_shifts(roads: RoadMap, crossings: Sequence[RiderCrossing], speed: float, every_s: float) -> tuple[float, ...]:
    """Return by how much later [s] each stream comes so that at the corners riders of one pass between those of another
    one, as far from them as possible."""
    lags = [
        (i, j, _find_due_s(roads, one, point, speed) - _find_due_s(roads, other, point, speed))
        for (i, one), (j, other) in combinations(enumerate(crossings), 2)
        for point in _find_corners(one, other)
    ]

    def find_least(shifts: Sequence[float]) -> float:
        apart = [(lag + shifts[i] - shifts[j]) % every_s for i, j, lag in lags]
        return round(min((min(one, every_s - one) for one in apart), default=every_s), DIGITS)

    choices = [tuple(k * every_s / SHIFTS for k in range(SHIFTS))] * (len(crossings) - 1)
    return max(((0.0, *shifts) for shifts in product(*choices)), key=find_least)


def _find_corners(one: RiderCrossing, other: RiderCrossing) -> tuple[shapely.Point, ...]:
    met = one.strip.line.intersection(other.strip.line)
    return tuple(part for part in shapely.get_parts(met) if isinstance(part, shapely.Point))


def _find_due_s(roads: RoadMap, crossing: RiderCrossing, point: shapely.Point, speed: float) -> float:
    """Return how much later than at the way [s] riders are at a point."""
    along = build_route_line(roads, crossing.strip.lanes).curve
    return (along.project(point.x, point.y)[0] - crossing.at_m) / speed


def _choose(**parameters: str | int | float | bool) -> PlaceChoice:
    fixed = {"arms": ARMS, "keeps_sight": False, "zebras": False, "main_lanes": 1, "skew_deg": 0.0, "bend": 0.0}
    return PlaceChoice("crossing", {**fixed, **parameters})


def _name_parameters(riding: tuple[float, float], every_s: tuple[float, float]) -> tuple[FamilyParameter, ...]:
    return (
        SITE,
        name_number("own", 1.6, 2.6, "in each direction of the first street"),
        name_number("across", 0.6, 1.6, "in each direction of the other street"),
        FamilyParameter("due_s", 3.0, 4.0, "s", "time after which the first CAVs are due at the riders' lines"),
        FamilyParameter("headway_s", 1.1, 1.7, "s", "time headway in a column of CAVs"),
        FamilyParameter("riding", *riding, "m/s", "speed of the riders"),
        FamilyParameter("before_s", 1.4, 2.2, "s", "how much earlier than the first CAVs the first riders are due"),
        FamilyParameter("every_s", *every_s, "s", "time between two riders"),
        FamilyParameter("lasts_s", 6.0, 8.5, "s", "how long a group of riders takes to pass"),
        FamilyParameter("pause_s", 10.5, 13.0, "s", "pause between two groups"),
        FamilyParameter("wall_m", 3.75, 4.05, "m", "from the edge of the lanes to the riders, behind what parks"),
        FamilyParameter("free_m", 0.3, 0.4, "m", "distance of what parks from the riders"),
        FamilyParameter("side_m", 1.75, 2.0, "m", "its distance from the middle of the CAVs' way"),
    )


_PEDELECS = _name_parameters(PEDELEC_MPS, (1.1, 1.4))
_SCOOTERS = _name_parameters((4.8, SCOOTER_MPS[1]), (1.1, 1.4))
FAMILIES = (
    ScenarioFamily(
        "four-streets",
        "CAVs of all four streets of a crossing with priority to the right wait for the pause of pedelecs on the cycle"
        " tracks, which parked lorries hide; then each has another one at its right.",
        (
            *(
                _choose(area=area, control="right_before_left", speed_kmh=50, beside="parking")
                for area in ("town", "suburb")
            ),
            _choose(area="town", control="right_before_left", speed_kmh=50, beside="cycle_lanes"),
        ),
        _PEDELECS,
        partial(stage_four_streets, RiderKind("bicycle", DELIVERING, PARKED, CONTROLS)),
    ),
    ScenarioFamily(
        "main-and-side-streets",
        "CAVs of all four streets of a crossing, one of which has priority, wait for the pause of pedelecs on the cycle"
        " tracks, which parked lorries hide; then they all meet.",
        tuple(
            _choose(area=area, control=control, speed_kmh=50, beside="parking")
            for area, control in (("town", "priority"), ("town", "stop"), ("suburb", "priority"), ("suburb", "stop"))
        ),
        _PEDELECS,
        partial(stage_four_streets, RiderKind("bicycle", DELIVERING, PARKED, CONTROLS)),
    ),
    ScenarioFamily(
        "quiet-crossing",
        "CAVs of all four streets of a quiet crossing wait for the pause of e-scooters on the cycle tracks, which"
        " parked lorries hide; then each has another one at its right.",
        (
            PlaceChoice(
                "town_block", {"area": "town", "control": "right_before_left", "rows": 2, "keeps_sight": False}
            ),
            _choose(area="town", control="right_before_left", speed_kmh=30, beside="parking"),
            _choose(area="suburb", control="right_before_left", speed_kmh=30, beside="parking"),
        ),
        _SCOOTERS,
        partial(stage_four_streets, RiderKind("e-scooter", DELIVERING, PARKED, CONTROLS)),
    ),
)
