"""Built-in scenarios of InterDrive that end after a few seconds, because their routes do. No tests in here."""

from pathlib import Path

from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite


def shorten(scenario: Scenario, metres: int) -> Scenario:
    """Cut the routes of all CAVs after so many metres."""
    egos = tuple(ego.model_copy(update={"route": ego.route[: metres + 1]}) for ego in scenario.egos)
    return scenario.model_copy(update={"egos": egos})


def make_short_suite(folder: Path, *patterns: str, metres: int = 15) -> Path:
    """Save the scenarios of InterDrive that the patterns choose, shortened, as a suite; returns its folder."""
    suite = load_suite("interdrive@0")
    scenarios = tuple(shorten(scenario, metres) for pattern in patterns for scenario in suite.select(pattern))
    save_suite(Suite(SuiteFile(name="short", title="A short suite"), folder, scenarios))
    return folder
