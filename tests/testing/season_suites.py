"""Suites of several seasons in a folder of a test, as if they came with mdrive-sumo."""

from pathlib import Path

import pytest

from mdrive_sumo.scenario import packaged_suites
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.season import BENCHMARK_SUITES
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite, seal_suite

PARTS = BENCHMARK_SUITES[:-1]


def write_season(folder: Path, season: int | str | None, scenario: Scenario) -> Suite:
    """Write a scenario of every part of a season, `season_ID` and so on, and return the whole suite."""
    for name in PARTS:
        own = scenario.model_copy(update={"id": f"{name}_{season or 0}"})
        about = SuiteFile(name=name, title=f"{name} of season {season or 0}", season=season)
        save_suite(seal_suite(Suite(about, folder / name, (own,))))
    whole = SuiteFile(name="mdrive", title="all", season=season, parts=PARTS)
    save_suite(Suite(whole, folder / "mdrive", ()))
    return load_suite(str(folder / "mdrive"))


def package_seasons(root: Path, newest: int, scenario: Scenario, patch: pytest.MonkeyPatch) -> None:
    """Make the packaged suites be those of seasons 0 to `newest`, with one scenario each."""
    patch.setattr(packaged_suites, "find_scenarios_root", lambda: root)
    for season in range(newest + 1):
        write_season(root / f"season_{season}" if season else root, season or None, scenario)
