"""Spawn points: start and goal of each CAV on its route, such that blind driving brings the CAVs together.

Every CAV starts from rest and, driven blindly, reaches its conflict with another one at nearly the same time.
"""

import random
from collections.abc import Iterator, Mapping

from mdrive_sumo.worlds.lane_routes import LaneRoute
from mdrive_sumo.worlds.placement.blind_driving import blind_distance, blind_travel_time
from mdrive_sumo.worlds.placement.cavs import NoRoomError, SpawnPoint
from mdrive_sumo.worlds.placement.lane_chains import RouteLines, find_conflict_stations

RUN_UP_M = (14.0, 56.0)
"""[m] Distance from start to conflict of the first CAV; the original uses 28 m before a junction on average."""
LEAST_RUN_UP_M = 12.0
CORRIDOR_M = (45.0, 70.0)
"""[m] Start of CAVs on roads without a junction, with room for a queue behind and obstacles ahead."""
BESIDE_M = (-5.0, 5.0)
"""[m] Distance ahead of a CAV at which one in the next lane starts."""
DRAWS = 30
TOGETHER_S = 0.5
"""[s] CAVs that reach their conflict within this time meet there."""
APART_S = 0.5
"""[s] How much earlier or later than another one a CAV may reach their conflict."""
GAP_M = (7.0, 14.0)
"""[m] Distance between box centres in a queue, a car's length included."""
RUN_OUT_M = 14.0
"""[m] Least distance from a conflict to the goal."""
RIM_M = 4.0
"""[m] Least distance of starts and goals from the ends of a route."""


LaneRoutes = Mapping[str, LaneRoute]
"""Lane routes by vehicle id."""
StartStations = dict[str, float]
"""Station of the start [m] by vehicle id."""


def choose_spawn_points(
    lines: RouteLines,
    ways: LaneRoutes,
    route_m: float,
    rng: random.Random,
    run_up_m: tuple[float, float] = RUN_UP_M,
) -> dict[str, SpawnPoint]:
    """Return start and goal of every CAV, with routes about `route_m` long. Raises NoRoomError.

    Of several random draws the one in which most pairs of CAVs meet. run_up_m: see `RUN_UP_M`.
    """
    draws = [_draw_starts(lines, ways, rng, run_up_m) for _ in range(DRAWS)]
    found = [draw for draw in draws if not isinstance(draw, NoRoomError)]
    if not found:
        raise next(draw for draw in draws if isinstance(draw, NoRoomError))
    starts = max(found, key=lambda draw: _count_encounters(draw, lines))
    last = {name: max((met[0] for _, met in find_conflicts(name, lines)), default=0.0) for name in starts}
    rims = {name: lines[name].last_m - RIM_M for name in starts}
    goals = {
        name: min(max(start + route_m * rng.uniform(0.9, 1.1), last[name] + RUN_OUT_M), rims[name])
        for name, start in starts.items()
    }
    return {name: SpawnPoint(start, goals[name]) for name, start in starts.items()}


def _draw_starts(
    lines: RouteLines, ways: LaneRoutes, rng: random.Random, run_up_m: tuple[float, float]
) -> StartStations | NoRoomError:
    starts: StartStations = {}
    for name in ways:
        start, length = _draw_start(name, starts, lines, ways, rng, run_up_m), lines[name].last_m
        if not RIM_M <= start <= length - RIM_M - RUN_OUT_M:
            return NoRoomError(f"{name}: expected room for its start on its way of {length:.0f} m, found {start:.0f} m")
        starts[name] = start
    return starts


def find_conflicts(name: str, lines: RouteLines) -> Iterator[tuple[str, tuple[float, float]]]:
    """Return the CAVs whose routes conflict with that of one, and the stations [m] on both routes."""
    for other in lines:
        if other != name and (met := find_conflict_stations(lines[name], lines[other])) is not None:
            yield other, met


def _count_encounters(starts: StartStations, lines: RouteLines) -> int:
    """Count the pairs of CAVs that blind driving brings together."""
    return sum(
        min(met[0] - starts[name], met[1] - starts[other]) > 0
        and abs(blind_travel_time(met[0] - starts[name]) - blind_travel_time(met[1] - starts[other])) < TOGETHER_S
        for name in starts
        for other, met in find_conflicts(name, lines)
    )


def draw_start_behind(name: str, starts: Mapping[str, float], ways: LaneRoutes, rng: random.Random) -> float | None:
    """Return a start [m] behind the CAVs that start on the same lane; None if there is none."""
    ahead = [start for other, start in starts.items() if ways[other].lanes[0] == ways[name].lanes[0]]
    return min(ahead) - rng.uniform(*GAP_M) if ahead else None


def _draw_start(
    name: str,
    starts: StartStations,
    lines: RouteLines,
    ways: LaneRoutes,
    rng: random.Random,
    run_up_m: tuple[float, float],
) -> float:
    """Return a start behind the CAVs on the same lane, beside those on the same road, or such that it meets another
    CAV."""
    if (behind := draw_start_behind(name, starts, ways, rng)) is not None:
        return behind
    beside = [starts[other] for other in starts if ways[other].entry == ways[name].entry]
    if beside:
        return beside[0] + rng.uniform(*BESIDE_M)
    met = dict(find_conflicts(name, lines))
    if not met:
        return rng.uniform(*CORRIDOR_M)
    first = min(found[0] for found in met.values())
    for other, start in starts.items():
        if other in met and met[other][1] > start:
            time = blind_travel_time(met[other][1] - start) + rng.uniform(-APART_S, APART_S)
            found = met[other][0] - blind_distance(time)
            if RIM_M <= found <= first - LEAST_RUN_UP_M:
                return found
    return max(first - rng.uniform(*run_up_m), RIM_M)
