"""Kind of place: a crossing of streets with 3 to 5 arms, with signs, signals or neither."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mdrive_sumo.worlds.places.arms import THROUGH_RAD, Arm, add_arm, compute_turn, connect_arms
from mdrive_sumo.worlds.places.building_rows import add_surroundings
from mdrive_sumo.worlds.places.junction_rules import (
    CONTROL_TYPES,
    CONTROL_WORDS,
    NUMBER_WORDS,
    add_signs,
    build_junction_sight,
    list_signal_arguments,
)
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import Drawn, between, choose
from mdrive_sumo.worlds.places.street_lines import draw_arm, trace_line
from mdrive_sumo.worlds.places.street_parking import CYCLE_M
from mdrive_sumo.worlds.places.surroundings import SURROUNDINGS

ANGLES_DEG = {3: (0.0, 90.0, 180.0), 4: (0.0, 90.0, 180.0, 270.0), 5: (0.0, 68.0, 140.0, 212.0, 286.0)}
"""Directions of the arms before they are turned; the first and the third are the main street."""
MAIN = (0, 2)
"""Indices of the arms of the main street."""
PARKING_M = 2.0
"""[m] Width of a parking lane (RASt 06, table 22: 2.00 m to 2.30 m)."""
SHARP_M = 14.0
"""[m] A corner that is sharper than a right angle gets so much more radius for each radian (found by `check_place`)."""
JITTER_DEG = 6.0
"""[deg] Largest deviation of an arm from its direction, beside the skew."""
AREAS = ("old_town", "town", "suburb", "commercial", "country", "open")
CONTROLS = ("right_before_left", "priority", "stop", "all_way_stop", "signals")


def _weigh_controls(drawn: Drawn) -> tuple[float, ...]:
    """Return the weights of `CONTROLS`: shares are chosen; five arms and old towns have no all-way stop."""
    by_area = {
        "old_town": (5.0, 3.0, 1.0, 0.0, 1.0),
        "town": (2.0, 3.0, 1.0, 1.0, 4.0),
        "suburb": (4.0, 2.0, 1.0, 1.5, 1.0),
        "commercial": (0.0, 2.0, 1.0, 1.0, 5.0),
        "country": (0.0, 4.0, 3.0, 1.0, 1.0),
        "open": (1.0, 3.0, 2.0, 1.0, 3.0),
    }
    weights = by_area[drawn["area"]]
    return weights if drawn["arms"] < 5 else (*weights[:3], 0.0, weights[4] + 1.0)


def _weigh_speeds(drawn: Drawn) -> tuple[float, ...]:
    by_area = {
        "old_town": (0.6, 0.4, 0.0, 0.0),
        "town": (1.0, 3.0, 0.0, 0.0),
        "suburb": (2.0, 1.0, 0.0, 0.0),
        "commercial": (0.0, 3.0, 1.0, 0.0),
        "country": (0.0, 0.0, 1.0, 3.0),
        "open": (0.5, 2.0, 1.0, 1.0),
    }
    # German law: right before left in zones of 30 km/h (StVO § 45 1c), elsewhere where signs are not worth it.
    return (1.0, 0.25, 0.0, 0.0) if drawn["control"] == "right_before_left" else by_area[drawn["area"]]


def _weigh_main_lanes(drawn: Drawn) -> tuple[float, ...]:
    if drawn["control"] == "signals":
        return {"old_town": (1.0, 0.0, 0.0), "country": (1.0, 1.0, 0.0)}.get(drawn["area"], (1.0, 3.0, 1.0))
    is_wide = drawn["control"] in ("priority", "stop") and drawn["area"] in ("town", "commercial")
    return (3.0, 1.0, 0.0) if is_wide else (1.0, 0.0, 0.0)


def _weigh_side_lanes(drawn: Drawn) -> tuple[float, ...]:
    return (1.0, 1.0) if drawn["control"] == "signals" and drawn["main_lanes"] > 1 else (1.0, 0.0)


def _weigh_turn_lanes(drawn: Drawn) -> tuple[float, ...]:
    if drawn["control"] == "signals":
        return (0.3, 0.7) if drawn["area"] != "old_town" else (1.0, 0.0)
    return (0.7, 0.3) if drawn["area"] == "country" and drawn["control"] in ("priority", "stop") else (1.0, 0.0)


def _weigh_beside(drawn: Drawn) -> tuple[float, ...]:
    """Return the weights of what lies beside the lanes: nothing, a parking lane or a cycle lane."""
    if drawn["area"] == "country" or drawn["turn_lanes"]:
        return (1.0, 0.0, 0.0 if drawn["area"] == "country" else 0.4)
    return {"old_town": (0.6, 0.4, 0.0), "commercial": (0.7, 0.0, 0.3)}.get(drawn["area"], (0.4, 0.4, 0.2))


def _weigh_zebras(drawn: Drawn) -> tuple[float, ...]:
    """Return the weights of no zebra crossings and some; R-FGÜ 2001 has none at 30 km/h and across two lanes."""
    if drawn["area"] == "country" or drawn["control"] == "right_before_left":
        return (1.0, 0.0)
    if drawn["control"] == "signals":
        return (0.1, 0.9)
    return (0.5, 0.5) if drawn["main_lanes"] == 1 else (1.0, 0.0)


def _weigh_sight(drawn: Drawn) -> tuple[float, ...]:
    share = SURROUNDINGS[drawn["area"]].keeps_sight if drawn["control"] not in ("signals", "all_way_stop") else 1.0
    return (share, 1.0 - share)


@dataclass(frozen=True)
class CrossingParameters:
    """Parameters of a crossing."""

    area: str = choose(*AREAS, doc="Kind of neighbourhood.", weights=(2.0, 3.0, 3.0, 1.5, 1.5, 0.0))
    arms: int = choose(3, 4, 5, doc="Streets that meet.", weights=(4.0, 7.0, 1.0))
    control: str = choose(*CONTROLS, doc="Rule of the junction.", weights=_weigh_controls)
    speed_kmh: int = choose(30, 50, 60, 70, doc="Speed limit of the main street [km/h].", weights=_weigh_speeds)
    main_lanes: int = choose(1, 2, 3, doc="Lanes each way of the main street.", weights=_weigh_main_lanes)
    side_lanes: int = choose(1, 2, doc="Lanes each way of the other streets.", weights=_weigh_side_lanes)
    turn_lanes: bool = choose(False, True, doc="Left-turn lanes on the main street.", weights=_weigh_turn_lanes)
    beside: str = choose("nothing", "parking", "cycle_lanes", doc="What lies beside the lanes.", weights=_weigh_beside)
    zebras: bool = choose(False, True, doc="Zebra crossings.", weights=_weigh_zebras)
    program: str = choose(
        "permitted", "protected", "split", doc="Left turns at signals: with oncoming traffic, after it, or arm by arm."
    )
    skew_deg: float = between(-25.0, 25.0, doc="Angle by which the other street deviates from a right angle [deg].")
    bend: float = between(0.0, 0.7, doc="Share of arms with a bend.")
    keeps_sight: bool = choose(True, False, doc="Whether sight triangles are free of buildings.", weights=_weigh_sight)


def build_crossing(draft: NetworkDraft, parameters: CrossingParameters, rng: random.Random) -> None:
    """Fill a draft with a crossing."""
    surroundings = SURROUNDINGS[parameters.area]
    draft.lane_m = surroundings.lane_m
    draft.description = _describe(parameters)
    arms = _draw_arms(parameters, rng)
    draft.nodes.append(Node("x", 0.0, 0.0, CONTROL_TYPES[parameters.control], _choose_radius(parameters, arms)))
    for arm in arms:
        add_arm(draft, "x", arm)
    if parameters.turn_lanes:
        connect_arms(draft, arms)
    main = [arm.name for k, arm in enumerate(arms) if k in MAIN]
    add_signs(draft, parameters.control, [arm.name for arm in arms], main)
    if parameters.zebras:
        draft.crossings += [("x", f"{arm.name}_in {arm.name}_out") for arm in arms if arm.pavement_m]
    if parameters.control == "signals":
        draft.netconvert = list_signal_arguments(parameters.program, parameters.speed_kmh)
    sight = build_junction_sight(arms, main, parameters.control, draft.lane_m) if parameters.keeps_sight else []
    add_surroundings(draft, surroundings, sight, rng)


def _choose_radius(parameters: CrossingParameters, arms: Sequence[Arm]) -> float:
    """Return the radius [m] of corners; RASt 06 has 6 to 10 m for cars, RAL 12 m and more outside of towns."""
    base_m = {"old_town": 5.5, "town": 6.5, "suburb": 6.5, "commercial": 8.0, "country": 12.0, "open": 8.0}[
        parameters.area
    ]
    sharpest = min(math.pi - abs(compute_turn(arm, other)) for arm in arms for other in arms if other is not arm)
    return round(base_m + max(math.pi / 2 - sharpest, 0.0) * SHARP_M, 1)


def _draw_arms(parameters: CrossingParameters, rng: random.Random) -> list[Arm]:
    turned_deg = rng.uniform(0.0, 360.0)
    surroundings = SURROUNDINGS[parameters.area]
    arms: list[Arm] = []
    for k, angle in enumerate(ANGLES_DEG[parameters.arms]):
        skew = parameters.skew_deg if k not in MAIN and parameters.arms < 5 else 0.0
        heading = math.radians(turned_deg + angle + skew + rng.uniform(-JITTER_DEG, JITTER_DEG))
        is_main = k in MAIN
        length_m = rng.uniform(95.0, 125.0) if parameters.speed_kmh < 50 else rng.uniform(120.0, 150.0)
        line = trace_line((0.0, 0.0), heading, draw_arm(rng, length_m, parameters.bend))
        arms.append(
            Arm(
                f"arm{k + 1}",
                line,
                parameters.main_lanes if is_main else parameters.side_lanes,
                round((parameters.speed_kmh if is_main else min(parameters.speed_kmh, 50)) / 3.6, 2),
                6 if is_main and parameters.control not in ("right_before_left", "all_way_stop") else 3,
                False,
                surroundings.pavement_m,
                CYCLE_M if parameters.beside == "cycle_lanes" else 0.0,
                PARKING_M if parameters.beside == "parking" else 0.0,
            )
        )
    if not parameters.turn_lanes:
        return arms
    return [
        replace(
            arm,
            turn_lane=k in MAIN and any(compute_turn(arm, other) > THROUGH_RAD for other in arms if other is not arm),
        )
        for k, arm in enumerate(arms)
    ]


def _describe(parameters: CrossingParameters) -> str:
    lanes = "one lane" if parameters.main_lanes == 1 else f"{NUMBER_WORDS[parameters.main_lanes]} lanes"
    return (
        f"a crossing of {NUMBER_WORDS[parameters.arms]} arms {SURROUNDINGS[parameters.area].words}: {lanes} each way,"
        f" {parameters.speed_kmh} km/h, {CONTROL_WORDS[parameters.control]}"
    )


CROSSING = PlaceKind(
    "crossing",
    "a crossing of 3 to 5 arms: priority to the right, signs, all-way stop or signals",
    CrossingParameters,
    build_crossing,
)
