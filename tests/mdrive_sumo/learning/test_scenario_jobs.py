"""Jobs of scenarios start so that no worker idles at the end."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from testing.short_suite import shorten

from mdrive_sumo.learning.scenario_jobs import LAST_JOBS_A_WORKER, ScenarioJob, estimate_work, order_jobs
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite


def load_one() -> Scenario:
    """Return a scenario with two CAVs or more."""
    return next(one for one in load_suite("interdrive@0").scenarios if len(one.egos) > 1 and not one.actors)


@dataclass
class Lengths:
    """Settings whose scenarios have one route of so many metres."""

    metres: list[int]

    def load_scenario(self, index: int) -> tuple[Scenario, None] | None:
        scenario = shorten(load_one(), self.metres[index])
        return (scenario.model_copy(update={"egos": scenario.egos[:1]}), None) if self.metres[index] else None


def order(metres: list[int], workers: int) -> list[int]:
    settings: Any = Lengths(metres)
    return [job.index for job in order_jobs([ScenarioJob(settings, Path(), i) for i in range(len(metres))], workers)]


def test_the_last_jobs_start_longest_first_and_the_others_by_index() -> None:
    last = 2 * LAST_JOBS_A_WORKER
    metres = [5, 30, 10, *range(10, 10 + last)]
    assert order(metres, 2) == [0, 1, 2, *reversed(range(3, 3 + last))]
    assert order([10, 30, 0, 20, 30], 2) == [1, 4, 3, 0, 2]  # equal ones by index, no scenario takes no time


def test_one_worker_needs_no_estimates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Lengths, "load_scenario", None)
    assert order([10, 30, 20], 1) == [0, 1, 2]


def test_work_is_the_way_of_all_cavs_and_doubles_with_sixty_others() -> None:
    scenario = load_one()
    metres = sum(len(ego.route) - 1 for ego in scenario.egos)
    vehicles = scenario.background.vehicles
    assert estimate_work(scenario) == pytest.approx(metres * (1 + len(vehicles) / 60))
    crowd = scenario.background.model_copy(update={"vehicles": (object(),) * 60})
    assert estimate_work(scenario.model_copy(update={"background": crowd})) == pytest.approx(2 * metres)
