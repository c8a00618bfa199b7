"""Plans of the packaged networks `train_*`, on which scenarios for training drive; the seed of each is its name."""

import random
from collections.abc import Callable, Mapping

from mdrive_sumo.worlds.places.junctions import (
    JunctionPlan,
    add_turn_lane_connections,
    build_junction,
    build_roundabout,
)
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.street_houses import HouseRows, add_houses
from mdrive_sumo.worlds.places.streets import SideStreet, StreetPlan, build_motorway, build_street, build_town

CROSS = (0.0, 90.0, 180.0, 270.0)
"""[deg] Directions of four arms at right angles."""
CLOSE, NEAR, FAR = HouseRows((1.0, 3.0)), HouseRows((4.0, 9.0)), HouseRows((11.0, 22.0), (8.0, 40.0), (12.0, 30.0))
SPARSE = HouseRows((5.0, 16.0), (15.0, 50.0), share=0.6)
"""Rows of houses from closed to loose; those of the packaged networks for training, which must stay as they are."""


def _build_crossing(plan: JunctionPlan, houses: HouseRows, lane_m: float = 3.5) -> Callable[[str, str], NetworkDraft]:
    def build(name: str, description: str) -> NetworkDraft:
        rng, draft = random.Random(name), NetworkDraft(name, description, lane_m)
        arms = build_junction(draft, plan, rng)
        if plan.type == "traffic_light":
            add_turn_lane_connections(draft, arms, plan.lanes)
        add_houses(draft, houses, rng)
        return draft

    return build


def _build_street(plan: StreetPlan, houses: HouseRows, lane_m: float = 3.5) -> Callable[[str, str], NetworkDraft]:
    def build(name: str, description: str) -> NetworkDraft:
        rng, draft = random.Random(name), NetworkDraft(name, description, lane_m)
        build_street(draft, plan, rng)
        add_houses(draft, houses, rng)
        return draft

    return build


def _build_ring(
    radius: float, lanes: int, angles: tuple[float, ...], houses: HouseRows
) -> Callable[[str, str], NetworkDraft]:
    def build(name: str, description: str) -> NetworkDraft:
        rng, draft = random.Random(name), NetworkDraft(name, description)
        build_roundabout(draft, radius, lanes, angles, 78.0)
        add_houses(draft, houses, rng)
        return draft

    return build


def _build_town(name: str, description: str) -> NetworkDraft:
    rng, draft = random.Random(name), NetworkDraft(name, description, 3.2)
    build_town(draft, (72.0, 64.0), 8.33, rng)
    add_houses(draft, CLOSE, rng)
    return draft


def _build_motorway(name: str, description: str) -> NetworkDraft:
    draft = NetworkDraft(name, description)
    build_motorway(draft, 420.0)
    add_houses(draft, HouseRows((14.0, 30.0), (20.0, 60.0), (12.0, 30.0), share=0.5), random.Random(name))
    return draft


TRAINING_PLANS: Mapping[str, tuple[str, Callable[[str, str], NetworkDraft]]] = {
    "train_crossing_narrow": (
        "training: two narrow streets cross between houses at the pavement; priority to the right",
        _build_crossing(JunctionPlan(CROSS, ((1, 1),) * 4, bend=0.5), CLOSE, 3.25),
    ),
    "train_crossing_skewed": (
        "training: a minor street crosses a main one at sixty degrees; houses stand back",
        _build_crossing(
            JunctionPlan((0.0, 60.0, 180.0, 240.0), ((1, 1),) * 4, "priority", 14.0, 13.89, (0, 2), bend=0.5), SPARSE
        ),
    ),
    "train_crossing_wide": (
        "training: uncontrolled crossing of two streets with two lanes each way, zebra crossings on all arms",
        _build_crossing(JunctionPlan(CROSS, ((2, 2),) * 4, radius=6.0, speed=11.11, bend=0.3, zebras=True), NEAR),
    ),
    "train_tee": (
        "training: a side street with a stop sign meets a bending street with two lanes each way",
        _build_street(
            StreetPlan(
                (((60.0, 0.0), (45.0, 120.0)), ((30.0, 0.0), (40.0, -90.0), (40.0, 0.0))),
                (SideStreet(-1, 1, "priority_stop", length_m=90.0),),
                2,
                13.89,
            ),
            NEAR,
        ),
    ),
    "train_staggered": (
        "training: two T-junctions 38 m apart on a narrow street, houses at the pavement",
        _build_street(
            StreetPlan(
                (((95.0, 0.0),), ((38.0, 0.0),), ((30.0, 0.0), (30.0, 70.0), (40.0, 0.0))),
                (SideStreet(1), SideStreet(-1)),
            ),
            CLOSE,
            3.3,
        ),
    ),
    "train_roundabout": (
        "training: roundabout of one lane with four arms at uneven angles",
        _build_ring(16.0, 1, (8.0, 86.0, 190.0, 275.0), FAR),
    ),
    "train_roundabout_wide": (
        "training: roundabout of two lanes with four arms and houses close to it",
        _build_ring(27.0, 2, (-6.0, 95.0, 178.0, 262.0), NEAR),
    ),
    "train_signals": (
        "training: signalled crossing, two lanes and a left-turn lane into it on all arms, zebra crossings",
        _build_crossing(
            JunctionPlan(CROSS, ((3, 2),) * 4, "traffic_light", 6.0, 13.89, (0, 2), 120.0, 0.4, 5.0, 2.0, True), NEAR
        ),
    ),
    "train_winding": (
        "training: two-lane street with bends of 60 m down to 8 m radius and one straight",
        _build_street(
            StreetPlan(
                (
                    (
                        (70.0, 0.0),
                        (50.0, 60.0),
                        (20.0, 0.0),
                        (34.0, -35.0),
                        (18.0, 0.0),
                        (25.0, 18.0),
                        (20.0, 0.0),
                        (18.0, -11.5),
                        (24.0, 0.0),
                        (12.0, -8.0),
                        (60.0, 0.0),
                        (55.0, 45.0),
                        (40.0, 0.0),
                    ),
                ),
                sidewalk_m=0.0,
            ),
            NEAR,
        ),
    ),
    "train_avenue": (
        "training: avenue with three lanes each way in a double bend",
        _build_street(
            StreetPlan((((90.0, 0.0), (80.0, 130.0), (80.0, -180.0), (40.0, 0.0)),), lanes=3, speed=13.89), NEAR
        ),
    ),
    "train_town": (
        "training: a block of a town with narrow streets and four crossings, priority to the right",
        _build_town,
    ),
    "train_corridor": (
        "training: street with two lanes each way, a crossing with lights and two T-junctions, zebra crossings",
        _build_street(
            StreetPlan(
                (((75.0, 0.0),), ((85.0, 240.0),), ((80.0, -200.0),), ((80.0, 0.0),)),
                (
                    SideStreet(-1, 1, "priority"),
                    SideStreet(0, 1, "traffic_light", True),
                    SideStreet(1, 1, "priority", True),
                ),
                2,
                11.11,
                2.0,
            ),
            NEAR,
        ),
    ),
    "train_motorway": (
        "training: motorway carriageway that loses a lane, then an on-ramp with an acceleration lane of 115 m",
        _build_motorway,
    ),
    "train_val_crossing": (
        "validation: a street with two lanes each way crosses a bending street of one; houses close to it",
        _build_crossing(
            JunctionPlan(
                (0.0, 75.0, 180.0, 280.0),
                ((2, 2), (1, 1), (2, 2), (1, 1)),
                "priority",
                8.5,
                11.11,
                (0, 2),
                105.0,
                0.7,
                zebras=True,
            ),
            HouseRows((2.0, 6.0)),
        ),
    ),
    "train_val_roundabout": (
        "validation: roundabout of one lane with five arms",
        _build_ring(21.0, 1, (0.0, 68.0, 140.0, 212.0, 290.0), HouseRows((6.0, 14.0))),
    ),
    "train_val_street": (
        "validation: street with two bends, an uncontrolled crossing and a T-junction",
        _build_street(
            StreetPlan(
                (((60.0, 0.0), (30.0, 25.0), (25.0, 0.0)), ((30.0, 0.0), (40.0, -60.0), (20.0, 0.0)), ((90.0, 0.0),)),
                (SideStreet(0, 1, "right_before_left"), SideStreet(-1, 1, "priority_stop")),
            ),
            HouseRows((1.5, 8.0)),
        ),
    ),
}


def draw_training_network(name: str) -> NetworkDraft:
    """Return the draft of a packaged training network."""
    description, build = TRAINING_PLANS[name]
    return build(name, description)
