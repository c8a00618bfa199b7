"""Write the built-in `interdrive` suite from its recipe: `python -m tools.build_interdrive_suite [--dry-run]`.

The recipe (`scenarios/interdrive/recipe.toml`) says for every CAV which lanes it takes, as steps joined by ">":

    "west_in_2 -45 > west_in_1 -40 > south_out_1 20"

The first step is the start and the last one the goal: lane and arc length of the box centre [m]. A step between them is
a lane on the way; its number, if it has one, is the arc length at which the lane change into it begins. Numbers below
zero count from the lane's end. What lies between two steps is found by routing.
"""

import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import copy_file
from mdrive_sumo.roads import RoadMap, Route, build_lane_route, find_lane_path, find_network_folder, load_road_map
from mdrive_sumo.scenario.packaged_suites import list_seasons
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite, seal_suite
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files

RECIPE_FILE = "recipe.toml"
BUCKET = "InterDrive"


@dataclass(frozen=True, slots=True)
class RecipeStep:
    """A lane on a CAV's route, and an arc length [m] on it (below zero: from its end) or None."""

    lane: str
    s: float | None


def parse_steps(text: str) -> tuple[RecipeStep, ...]:
    """Parse "lane s > lane > lane s"; raise InputError."""
    found: list[RecipeStep] = []
    for part in text.split(">"):
        words = part.split()
        try:
            lane, *number = words
            found.append(RecipeStep(lane, float(number[0]) if number else None))
        except ValueError:
            raise InputError(f"recipe: expected steps 'lane [arc length]', found {part.strip()!r}") from None
    if len(found) < 2 or found[0].s is None or found[-1].s is None:
        raise InputError(f"recipe: expected an arc length for start and goal, found {text!r}")
    return tuple(found)


def build_route(roads: RoadMap, way: Sequence[RecipeStep]) -> Route:
    """Build the dense route through the steps; raise InputError if there is none."""
    _check_lanes(roads, way)
    lanes = [way[0].lane]
    change_at: dict[int, float] = {}
    for step in way[1:]:
        here = roads.lanes[lanes[-1]]
        if step.lane in (here.left, here.right):
            if step.s is not None and step is not way[-1]:
                change_at[len(lanes) - 1] = _to_arc_length(roads, RecipeStep(here.id, step.s))
            lanes.append(step.lane)
        elif step.lane != here.id:
            lanes.extend(find_lane_path(roads, here.id, step.lane)[1:])
    return build_lane_route(roads, lanes, _to_arc_length(roads, way[0]), _to_arc_length(roads, way[-1]), change_at)


def _check_lanes(roads: RoadMap, way: Sequence[RecipeStep]) -> None:
    for step in way:
        if step.lane not in roads.lanes:
            raise InputError(f"recipe: expected a car lane of network {roads.name}, found {step.lane!r}")


def _to_arc_length(roads: RoadMap, step: RecipeStep) -> float:
    s = step.s or 0.0
    return s + roads.lanes[step.lane].centre.length if s < 0 else s


def build_ego(roads: RoadMap, name: str, text: str) -> Ego:
    """Build a CAV from its line of the recipe, at rest on the first point of its route."""
    route = build_route(roads, parse_steps(text))
    xy, yaw = route.xy.tolist(), route.yaw.tolist()
    points = tuple((round(x, 3), round(y, 3), round(a, 4)) for (x, y), a in zip(xy, yaw, strict=True))
    x, y, angle = points[0]
    return Ego(id=name, start=Pose(x=x, y=y, yaw=angle), lanes=route.lanes, route=points)


def build_scenario(entry: dict[str, Any]) -> Scenario:
    """Build a scenario from its table of the recipe; raise InputError."""
    roads = load_road_map(find_network_folder(entry["network"]))
    try:
        egos = tuple(build_ego(roads, str(i), text) for i, text in enumerate(entry["cavs"]))
    except InputError as error:
        raise InputError(f"{entry['id']}: {error}") from None
    return Scenario(
        id=entry["id"],
        bucket=BUCKET,
        category=entry["category"],
        network=entry["network"],
        description=entry["description"],
        signals=entry.get("signals", "frozen-green"),
        egos=egos,
    )


def build_suite(folder: Path) -> Suite:
    """Build the suite described by the recipe in `folder`."""
    recipe = tomllib.loads((folder / RECIPE_FILE).read_text())
    return Suite(SuiteFile(**recipe["suite"]), folder, tuple(build_scenario(entry) for entry in recipe["scenario"]))


def write_suite(folder: Path) -> Suite:
    """Write and seal `suite.json` and every `scenario.json` of the recipe in `folder`."""
    save_suite(build_suite(folder))
    suite = seal_suite(load_suite(str(folder)))  # seal the rounded values of the files
    save_suite(suite)
    return suite


@click.command(cls=ToolCommand, context_settings=HELP)
@dry_run_option
def main(dry_run: bool) -> None:
    """Write the packaged suite `interdrive` anew from its recipe, `recipe.toml` in its folder."""
    folder = list_seasons("interdrive")[0]
    with tempfile.TemporaryDirectory() as scratch:
        copy_file(folder / RECIPE_FILE, Path(scratch, RECIPE_FILE))
        write_suite(Path(scratch))
        replace_changed_files(Path(scratch), folder, dry_run=dry_run)


if __name__ == "__main__":
    main()
