"""Draw training curves side by side: the whole loss, and what validation measured, of systems or of detectors.

    python -m tools.draw_training_curves STEM NAME=CURVES[,CURVES]...

writes STEM.png. CURVES is a `curves.csv` of `learn train` or `learn train-detector`; several of one name are rounds,
one after the other.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import click
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.training.training_curves import read_curves
from mdrive_sumo.report.figure_style import COLOURS, MARKERS, open_figure, render_figure
from tools.tool_command import HELP, ToolCommand, write_small_picture

COLUMNS = 4
PANEL_IN, LEGEND_IN = (3.3, 2.5), 0.4
LOSS, JUDGED = "loss/total", "validation/"
Curve = Sequence[tuple[int, float]]
"""Steps and values."""


def join_rounds(paths: Sequence[Path]) -> tuple[Mapping[str, Curve], Sequence[int]]:
    """Return the loss and the validation curves by name over all rounds, and the step at which each later one begins.

    Raises InputError for a file without a loss.
    """
    curves: dict[str, list[tuple[int, float]]] = {}
    begins: list[int] = []
    before = 0
    for path in paths:
        rows = read_curves(path)
        if not any(name == LOSS for _, name, _ in rows):
            raise InputError(f"{path}: expected a curves.csv with {LOSS}, found none")
        begins.append(before)
        for step, name, value in rows:
            if name == LOSS or name.startswith(JUDGED):
                curves.setdefault(name, []).append((before + step, value))
        before += max(step for step, _, _ in rows)
    return curves, begins[1:]


def _draw(axes: Axes, curves: Mapping[str, Curve], begins: Sequence[int]) -> Mapping[str, Line2D]:
    """Draw the loss by the left axis, thin, and validation by the right one; return the lines by name."""
    axes.plot(*zip(*curves[LOSS], strict=True), color="#999999", linewidth=0.8, label="loss")
    axes.set(xlabel="step", ylim=(0.0, None))
    right = axes.twinx()
    right.grid(visible=False)
    right.spines["right"].set_visible(True)
    for place, (name, curve) in enumerate((name, curve) for name, curve in curves.items() if name != LOSS):
        right.plot(
            *zip(*curve, strict=True),
            label=name.removeprefix(JUDGED),
            linewidth=1.2,
            color=COLOURS[place % len(COLOURS)],
            marker=MARKERS[place % len(MARKERS)],
            markersize=3,
        )
    for step in begins:
        axes.axvline(step, color="black", linestyle=":", linewidth=0.8)
    return {str(line.get_label()): line for line in (*axes.get_lines()[:1], *right.get_lines())}


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("stem", type=click.Path(path_type=Path))
@click.argument("trainings", nargs=-1, required=True, metavar="NAME=CURVES...")
def main(stem: Path, trainings: Sequence[str]) -> None:
    """Draw the curves of TRAININGS into STEM.png."""
    panels: dict[str, tuple[Mapping[str, Curve], Sequence[int]]] = {}
    for text in trainings:
        name, equals, files = text.partition("=")
        if not equals:
            raise InputError(f"expected NAME=CURVES, found {text!r:.60}")
        panels[name] = join_rounds([Path(file) for file in files.split(",")])
    rows = -(-len(panels) // COLUMNS)
    columns = min(len(panels), COLUMNS)
    lines: dict[str, Line2D] = {}
    with open_figure(columns * PANEL_IN[0], rows * PANEL_IN[1] + LEGEND_IN) as figure:
        for place, (name, (curves, begins)) in enumerate(panels.items(), start=1):
            axes = figure.add_subplot(rows, columns, place)
            axes.set_title(name, fontsize=10)
            lines |= _draw(axes, curves, begins)
        figure.legend(handles=[*lines.values()], loc="outside lower center", ncols=len(lines), frameon=False)
        content = render_figure(figure, "png")
    write_small_picture(content, Path(f"{stem}.png"))


if __name__ == "__main__":
    main()
