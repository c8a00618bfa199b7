"""Draw contact sheets of places and scenarios, to look at: could this stand in a city?

    python -m tools.draw_world_sheets places places.png [--kind crossing] [--seed 0] [--count 30]
    python -m tools.draw_world_sheets scenarios scenarios.png --suite mdrive [--count 30]
    python -m tools.draw_world_sheets page [--dry-run]

Places are drawn in the order of their kinds, each by the next seed; of a suite's scenarios, every so many-th is drawn.
`page` writes the sheet of places and the tables of kinds and parameters of docs/place-kinds.md.
"""

import dataclasses
import math
import tempfile
import textwrap
from collections.abc import Callable, Sequence
from itertools import count, cycle
from pathlib import Path

import click
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from PIL import Image

from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.report.map_view import fit_view
from mdrive_sumo.report.scenario_plot import draw_map, draw_scenario
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.worlds.places import PLACE_KINDS, Place, check_place, draw_place, write_place
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files

COLUMNS = 6
SIDE_INCHES = 4.0
GREEN = "#6f9f6a"
PLANTS = ("hedge", "tree")
VIEW_M = 85.0
"""[m] Half of the side of a picture of a place around its middle."""
LONG_VIEW_M = 200.0
"""[m] That of a place whose lanes are longer than `LONG_M`."""
LONG_M = 150.0
DOCS = Path(__file__).parents[1] / "docs"
PAGE, PAGE_SHEET = Path("place-kinds.md"), Path("images/worlds/places.webp")
BEGIN, END = "<!-- kinds:begin, written by tools/draw_world_sheets.py -->", "<!-- kinds:end -->"
QUALITY = 60
"""Quality of WebP: 30 places in 300 KB."""

Drawing = Callable[[Axes], None]


def draw_sheet(drawings: Sequence[Drawing], path: Path) -> None:
    """Write a picture with one field for each drawing."""
    rows = math.ceil(len(drawings) / COLUMNS)
    figure = Figure(figsize=(COLUMNS * SIDE_INCHES, rows * SIDE_INCHES), dpi=90, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    for k, draw in enumerate(drawings):
        row, column = divmod(k, COLUMNS)
        box = (column / COLUMNS + 0.002, 1 - (row + 1) / rows + 0.002, 1 / COLUMNS - 0.004, 0.88 / rows)
        draw(figure.add_axes(box))
    make_parents(path)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    image.save(path, quality=QUALITY, method=6)  # PNG ignores both


def draw_place_field(axes: Axes, place: Place) -> None:
    """Draw the network of a place with its plants, its description, and the faults that its check finds."""
    with tempfile.TemporaryDirectory() as scratch:
        roads = load_road_map(write_place(place, Path(scratch, place.name)))
        faults = check_place(roads)
    draw_map(axes, roads, fit_view(_list_view_corners(roads), margin_m=4.0, min_aspect=0.999))
    for building in roads.buildings:
        if building.id.startswith(PLANTS):
            axes.add_patch(Polygon(building.outline, facecolor=GREEN, edgecolor=GREEN, zorder=5.5))
    for row in roads.parking:
        axes.plot(*row.xy.T, color="#3355bb", linewidth=0.8, zorder=6)
    for stop in roads.bus_stops:
        axes.plot(*stop.xy.T, color="#bb3355", linewidth=2.0, zorder=6)
    for sign in roads.yield_signs:
        lane = roads.lanes[sign.lane].centre
        axes.plot(*lane.xy[-1], marker="v", color="#cc2222", markersize=5, zorder=6)
    text = textwrap.fill(f"{place.name}: {place.description}", 62)
    axes.set_title("\n".join([text, *faults[:3]]), fontsize=6.5, color="#aa0000" if faults else "#222222", pad=2)


def _list_view_corners(roads: RoadMap) -> np.ndarray:
    """Return the corners of the view: what has lanes, but not more than `VIEW_M` around the middle of all junctions."""
    lanes = shapely.MultiLineString([lane.centre.xy for lane in roads.driving])
    inside = [lane.centre.xy for lane in roads.driving if lane.junction]
    middle = np.concatenate(inside).mean(0) if inside else np.array(lanes.centroid.coords[0])
    left, low, right, high = lanes.bounds
    corners = np.array([(left, low), (right, high)])
    side = LONG_VIEW_M if max(lane.centre.length for lane in roads.driving) > LONG_M else VIEW_M
    return np.clip(corners, middle - side, middle + side)


def draw_scenario_field(axes: Axes, scenario: Scenario, roads: RoadMap) -> None:
    """Draw a scenario at its start, with its description."""
    view = fit_view(np.concatenate([ego.xy for ego in scenario.egos]), min_aspect=0.999)
    draw_scenario(axes, scenario, roads, view)
    axes.set_title(textwrap.fill(f"{scenario.id}: {scenario.description}", 62), fontsize=6.5, pad=2)


@click.group(context_settings=HELP)
def main() -> None:
    """Draw contact sheets of places and scenarios."""


@main.command("places", cls=ToolCommand)
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--kind", "kinds", multiple=True, type=click.Choice(tuple(PLACE_KINDS)), help="Default: all kinds.")
@click.option("--seed", default=0, help="Of the first place.")
@click.option("--count", "size", default=30, help="Places.")
def draw_places(path: Path, kinds: Sequence[str], seed: int, size: int) -> None:
    """Draw places into PATH, a PNG or WebP file."""
    draw_sheet(list_place_drawings(kinds or tuple(PLACE_KINDS), seed, size), path)


def list_place_drawings(kinds: Sequence[str], seed: int, size: int) -> list[Drawing]:
    """Return the drawings of so many places, of the kinds by turns and with growing seeds."""
    draws: list[Drawing] = []
    for _, kind, number in zip(range(size), cycle(kinds), count(seed), strict=False):
        place = draw_place(kind, number)
        draws.append(lambda axes, place=place: draw_place_field(axes, place))
    return draws


def format_kinds() -> str:
    """Return a section in Markdown for each kind of place, with a table of its parameters."""
    lines: list[str] = []
    for kind in PLACE_KINDS.values():
        lines += [f"## {kind.name}", "", f"{kind.description[0].upper()}{kind.description[1:]}.", ""]
        lines += ["| parameter | values | meaning |", "|---|---|---|"]
        for parameter in dataclasses.fields(kind.parameters):
            lines.append(f"| `{parameter.name}` | {parameter.metadata['range']} | {parameter.metadata['doc']} |")
        lines.append("")
    return "\n".join(lines)


@main.command("page", cls=ToolCommand)
@dry_run_option
def write_page(dry_run: bool) -> None:
    """Write the sheet of places and the tables of docs/place-kinds.md."""
    before, _, rest = (DOCS / PAGE).read_text("utf-8").partition(BEGIN)
    with tempfile.TemporaryDirectory() as scratch:
        draw_sheet(list_place_drawings(tuple(PLACE_KINDS), 0, 30), Path(scratch, PAGE_SHEET))
        write_text(Path(scratch, PAGE), f"{before}{BEGIN}\n\n{format_kinds()}\n{END}{rest.partition(END)[2]}")
        replace_changed_files(Path(scratch), DOCS, dry_run=dry_run)


@main.command("scenarios", cls=ToolCommand)
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--suite", "name", default="mdrive", help="Name or folder of a suite.")
@click.option("--count", "size", default=30, help="Scenarios.")
def draw_scenarios(path: Path, name: str, size: int) -> None:
    """Draw scenarios of a suite into PATH, a PNG or WebP file."""
    suite = load_suite(name)
    draws: list[Drawing] = []
    for scenario in suite.scenarios[:: max(len(suite.scenarios) // size, 1)][:size]:
        roads = load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id)))
        draws.append(lambda axes, one=scenario, roads=roads: draw_scenario_field(axes, one, roads))
    draw_sheet(draws, path)


if __name__ == "__main__":
    main()
