"""What scripted road users cost, in milliseconds a tick.

Run it alone: python tests/bench/actors.py
"""

import math
import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from testing.actors_world import actor
from testing.worlds import straight_ego, straight_road, straight_scenario

from mdrive_sumo.actors import ScriptedActors
from mdrive_sumo.core.state import Actors, EgoState, Frame
from mdrive_sumo.scenario.scripted_actor import Actor

Row = tuple[str, float, str, str]
ACTORS, BACKGROUND, TICKS = 85, 20, 400
SPEEDS = {"vehicle": 8.0, "pedestrian": 1.4, "cyclist": 4.0}


def crowd(rng: np.random.Generator) -> list[Actor]:
    """Road users of every kind that all go somewhere through each other."""
    found: list[Actor] = []
    for i in range(ACTORS):
        kind = list(SPEEDS)[i % 3]
        (x, y), yaw = rng.uniform(-60, 60, 2), rng.uniform(-3, 3)
        points = [(x + math.cos(yaw) * s, y + math.sin(yaw) * s) for s in (0, 20, 50, 200)]
        found.append(actor(f"a{i:02}", kind, points=points, speed=SPEEDS[kind]))
    return found


def actor_rows() -> Iterator[Row]:
    """Median and 95th percentile of `Cast.advance`, and the median of merging with SUMO's vehicles."""
    rng = np.random.default_rng(1)
    world = straight_scenario(straight_ego("0"), straight_ego("1", x=30))
    cast = ScriptedActors(world.model_copy(update={"actors": tuple(crowd(rng))}), straight_road())
    egos = {"0": EgoState(10, 0, 0, 5.0), "1": EgoState(30, 0, 0, 5.0)}
    one, x, y = np.ones(BACKGROUND), rng.uniform(-60, 60, BACKGROUND), rng.uniform(-60, 60, BACKGROUND)
    ids = tuple(f"b{i:02}" for i in range(BACKGROUND))
    cars = Actors(ids, np.zeros(BACKGROUND, np.uint8), x, y, 0 * one, 5 * one, 4.5 * one, 1.8 * one)
    advancing: list[float] = []
    merging: list[float] = []
    for tick in range(TICKS):
        since = time.thread_time()
        everybody = cars.merge(cast.present)
        between = time.thread_time()
        cast.advance(Frame(tick, egos, everybody, {}), ())
        merging.append(1e3 * (between - since))
        advancing.append(1e3 * (time.thread_time() - between))
    p95 = sorted(advancing)[round(0.95 * TICKS)]
    yield f"{ACTORS} scripted road users, advance", statistics.median(advancing), "ms", "-"
    yield f"{ACTORS} scripted road users, advance, 95th percentile", p95, "ms", "-"
    yield f"{ACTORS} scripted road users, merge with SUMO's vehicles", statistics.median(merging), "ms", "-"


if __name__ == "__main__":
    for row in actor_rows():
        sys.stdout.write(f"{row[0]:<66}{row[1]:>10.3f} {row[2]:<8}{row[3]}\n")
