"""Draw the gallery of the documentation: a picture and a sentence for each packaged scenario, by category.

    python -m tools.draw_scenario_gallery [--dry-run]

Writes docs/gallery.md and a picture of each scenario into docs/images/gallery/.
"""

import tempfile
from collections import defaultdict
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import click
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.report.map_view import fit_view
from mdrive_sumo.report.scenario_plot import draw_scenario
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files

DOCS = Path(__file__).parents[1] / "docs"
PAGE, PICTURES = Path("gallery.md"), Path("images/gallery")
SUITE = "mdrive@0"
SIDE_PX = 300
"""Longer side of a picture: three fit beside each other on a page."""
QUALITY = 75
"""Quality of WebP: 3 KB a picture, less than half of PNG, and names of CAVs stay readable."""

HEAD = """# Scenario gallery

The 225 built-in scenarios (`mdrive-sumo list scenarios --suite mdrive@0`) by bucket and category. They are remakes of
our own with the paper's composition and hold no recorded data; the suite `hard` has [a page of its own](hard.md). CAVs
are coloured and have routes and goals; background vehicles are grey, scripted road users and obstacles have the colours
of the [replay](replay.md). `mdrive-sumo show ID --suite mdrive@0` draws a scenario in full size.

`python -m tools.draw_scenario_gallery` writes this page.
"""


def draw_thumbnail(scenario: Scenario, roads: RoadMap, path: Path) -> None:
    """Write a small picture of a scenario at its start, without captions."""
    view = fit_view(np.concatenate([ego.xy for ego in scenario.egos]))
    width, height = (side * SIDE_PX / max(view.size) / 100.0 for side in view.size)
    figure = Figure(figsize=(3.0 * width, 3.0 * height), dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    draw_scenario(figure.add_axes((0.0, 0.0, 1.0, 1.0)), scenario, roads, view)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    small = image.resize((round(100 * width), round(100 * height)), Image.Resampling.LANCZOS)
    make_parents(path)
    small.save(path, quality=QUALITY, method=6)


@cache
def _load_roads(folder: Path) -> RoadMap:
    return load_road_map(folder)


def format_page(scenarios: Sequence[Scenario]) -> str:
    """Return the page in Markdown: a table of pictures and sentences for each category."""
    by_category: dict[tuple[str, str], list[Scenario]] = defaultdict(list)
    for scenario in scenarios:
        by_category[scenario.bucket, scenario.category].append(scenario)
    lines = [HEAD]
    bucket = ""
    for (where, category), members in by_category.items():
        if where != bucket:
            bucket = where
            lines.append(f"## {bucket}\n")
        lines.append(f"### {category}\n\n| | | |\n|---|---|---|")
        for row in (members[k : k + 3] for k in range(0, len(members), 3)):
            lines.append(f"| {' | '.join(_format_cell(scenario) for scenario in row)} |")
        lines.append("")
    return "\n".join(lines)


def _format_cell(scenario: Scenario) -> str:
    alt = f"{len(scenario.egos)} CAVs"
    return f"![{alt}]({PICTURES}/{scenario.id}.webp)<br>`{scenario.id}`<br>{scenario.description}"


@click.command(cls=ToolCommand, context_settings=HELP)
@dry_run_option
def main(dry_run: bool) -> None:
    """Draw every scenario of the packaged suites, and write docs/gallery.md."""
    suite = load_suite(SUITE)
    with tempfile.TemporaryDirectory() as scratch:
        for scenario in suite:
            roads = _load_roads(find_network_folder(scenario.network, suite.find_folder(scenario.id)))
            draw_thumbnail(scenario, roads, Path(scratch, PICTURES, f"{scenario.id}.webp"))
        write_text(Path(scratch, PAGE), format_page(suite.scenarios))
        replace_changed_files(Path(scratch), DOCS, dry_run=dry_run)


if __name__ == "__main__":
    main()
