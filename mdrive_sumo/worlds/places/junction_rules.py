"""Rules of junctions: types for netconvert, signs, signal programs, and where drivers need to see each other."""

from collections.abc import Mapping, Sequence

from shapely.geometry.base import BaseGeometry

from mdrive_sumo.worlds.places.arms import Arm
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.sight_triangles import build_sight_triangles

CONTROL_TYPES: Mapping[str, str] = {
    "right_before_left": "right_before_left",
    "priority": "priority",
    "stop": "priority_stop",
    "all_way_stop": "allway_stop",
    "signals": "traffic_light",
}
"""SUMO's junction type of each rule."""
CONTROL_WORDS: Mapping[str, str] = {
    "right_before_left": "priority to the right",
    "priority": "yield signs on the minor street",
    "stop": "stop signs on the minor street",
    "all_way_stop": "stop signs on all arms",
    "signals": "signals",
}
NUMBER_WORDS: Mapping[int, str] = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five"}
YELLOW_S = ((50, 3), (60, 4), (70, 5))
"""Speed limit [km/h] and yellow time [s] of German signals (RiLSA 2010, 2.5)."""
ALL_RED_S = 2
"""[s] Chosen: clearance of a junction of 25 m at 10 m/s after the yellow time."""
CYCLE_S = 70
"""[s] Chosen within the 60 to 90 s of RiLSA 2010."""
LEFT_GREEN_S = 8
"""[s] Of a phase for left turns: four vehicles at 2 s each."""


def add_signs(draft: NetworkDraft, control: str, arms: Sequence[str], main: Sequence[str]) -> None:
    """Add the signs of a junction: at the ends of NAME_in of the arms that must give way."""
    minor = [f"{arm}_in" for arm in arms if arm not in main]
    if control == "stop":
        draft.stops += minor
    elif control == "priority":
        draft.yields += minor
    elif control == "all_way_stop":
        draft.stops += [f"{arm}_in" for arm in arms]


def list_signal_arguments(program: str, speed_kmh: float) -> tuple[str, ...]:
    """Return netconvert's arguments for a signal program: "permitted", "protected" or "split"."""
    yellow_s = next((time for limit, time in YELLOW_S if speed_kmh <= limit), YELLOW_S[-1][1])
    times = ("--tls.cycle.time", str(CYCLE_S), "--tls.yellow.time", str(yellow_s), "--tls.allred.time", str(ALL_RED_S))
    if program == "split":
        return (*times, "--tls.layout", "incoming")
    return (*times, "--tls.left-green.time", str(LEFT_GREEN_S if program == "protected" else 0))


def build_junction_sight(arms: Sequence[Arm], main: Sequence[str], control: str, lane_m: float) -> list[BaseGeometry]:
    """Return the areas that stay free of what blocks sight; none at signals and all-way stops."""
    if control in ("signals", "all_way_stop"):
        return []
    is_equal = control == "right_before_left"
    return build_sight_triangles(
        [
            arm.build_approach(
                lane_m, has_priority=is_equal or arm.name in main, gives_way=is_equal or arm.name not in main
            )
            for arm in arms
        ]
    )
