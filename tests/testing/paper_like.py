"""Suites with the numbers of the paper's tables, on straight and bent routes of no real network. No tests in here."""

import math
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from mdrive_sumo.scenario.categories import FIGURES, Category, CategoryFigures
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.suite import Suite, SuiteFile
from mdrive_sumo.scenario.weather import WeatherName

ROUTE, TURN = 1.02, 0.95
"""The paper's bucket is not the mean of its categories; with these factors both are met."""
WEATHERS: tuple[WeatherName, ...] = (
    "cloudy", "night", "default", "rain", "cloudy", "night", "default", "rain", "cloudy", "night",
)  # fmt: skip


def interaction(folder: Path) -> Suite:
    """A suite that nothing is wrong with."""
    return Suite(SuiteFile(name="interaction", title="Like the paper's"), folder, _scenarios())


@cache
def _scenarios() -> tuple[Scenario, ...]:
    return tuple(one for category, figures in FIGURES.items() for one in _of(category, figures))


def _of(category: Category, figures: CategoryFigures) -> Iterator[Scenario]:
    ego, cone = _ego(figures), Actor(id="cone", kind="static", length=0.4, width=0.4, start=Pose(x=0, y=0, yaw=0))
    cavs, actors = (_shared(round(mean * figures.count), figures.count) for mean in (figures.cavs, figures.actors))
    for k in range(figures.count):
        yield Scenario(
            id=f"{category}_{k:02d}",
            bucket="Interaction",
            category=category,
            network="none",
            egos=tuple(ego.model_copy(update={"id": str(i)}) for i in range(cavs[k])),
            actors=tuple(cone.model_copy(update={"id": f"cone{i}"}) for i in range(actors[k])),
            weather=WEATHERS[k % 10],
        )


def _shared(total: int, count: int) -> list[int]:
    return [total // count + (k < total % count) for k in range(count)]


def _ego(figures: CategoryFigures) -> Ego:
    """An arc; what smoothing takes off its ends is added."""
    hops = round(figures.route_m * ROUTE)
    bend = math.radians(figures.heading_change_deg * TURN) / (hops - 2)
    x, y, points = 0.0, 0.0, [(0.0, 0.0, 0.0)]
    for k in range(hops):
        x, y = x + math.cos(k * bend), y + math.sin(k * bend)
        points.append((x, y, k * bend))
    return Ego(id="0", start=Pose(x=0, y=0, yaw=0), lanes=("a_0",), route=tuple(points))
