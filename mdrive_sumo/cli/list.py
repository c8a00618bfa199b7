"""`mdrive-sumo list`."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping

import click

from mdrive_sumo.agents import AGENTS
from mdrive_sumo.report.text import Row, text_table
from mdrive_sumo.roads import load, packaged_networks
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.scenario.catalog import Suite, load_suite, packaged_suites
from mdrive_sumo.scenario.spec import Scenario
from mdrive_sumo.scenario.statistics import PAPER, SuiteStatistics, statistics

STATISTICS_HEADER: Row = ("scenarios", "CAVs", "mean CAVs", "route [m]", "heading change [deg]", "background")


def _suites(_: str) -> str:
    return "\n\n".join(_about_suite(load_suite(name)) for name in packaged_suites()) or "no suites"


def _about_suite(suite: Suite) -> str:
    rows = [(suite.name, *_statistics_cells(statistics(suite.scenarios)))]
    if suite.name in PAPER:
        rows.append(("in the paper", *_statistics_cells(PAPER[suite.name])))
    categories = Counter(scenario.category for scenario in suite.scenarios)
    return "\n".join(
        (
            suite.about.title,
            "",
            text_table(("suite", *STATISTICS_HEADER), rows),
            "",
            "scenarios per category",
            text_table(("category", "scenarios"), ((name, str(count)) for name, count in categories.items())),
        )
    )


def _statistics_cells(found: SuiteStatistics) -> Row:
    means = (found.mean_cavs, found.mean_route_m, found.mean_heading_change_deg, found.mean_actors)
    return (str(found.scenarios), str(found.cavs), *(f"{mean:.2f}" for mean in means))


def _scenarios(suite: str) -> str:
    header = ("scenario", "category", "network", *STATISTICS_HEADER[1:2], *STATISTICS_HEADER[3:])
    return text_table(header, map(_scenario_row, load_suite(suite).scenarios))


def _scenario_row(scenario: Scenario) -> Row:
    _, cavs, _, *rest = _statistics_cells(statistics((scenario,)))
    return (scenario.id, scenario.category, scenario.network, cavs, *rest)


def _agents(_: str) -> str:
    rows = [(name, (factory.__doc__ or "").strip().split("\n")[0]) for name, factory in AGENTS.items()]
    return text_table(("agent", "what it does"), rows)


def _networks(_: str) -> str:
    return text_table(("network", "lanes", "buildings", "stop signs", "description"), _network_rows())


def _network_rows() -> Iterator[Row]:
    for name, folder in packaged_networks().items():
        roads, about = load(folder), read_network_file(folder)
        signs = "unknown" if roads.stop_signs is None else str(len(roads.stop_signs))
        yield name, str(len(roads.lanes)), str(len(roads.buildings)), signs, about.description


LISTS: Mapping[str, Callable[[str], str]] = {
    "suites": _suites,
    "scenarios": _scenarios,
    "agents": _agents,
    "networks": _networks,
}


@click.command("list")
@click.argument("what", type=click.Choice(tuple(LISTS)))
@click.option("--suite", default="interdrive", show_default=True, help="Whose scenarios: a name or a folder.")
def command(what: str, suite: str) -> None:
    """List suites (with the paper's statistics), scenarios, agents or networks."""
    click.echo(LISTS[what](suite))
