"""Pictures of the studies of two agents: the matrix of cross-play, and scores against the penetration."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes

from mdrive_sumo.report.figure_style import COLOURS, MARKERS, open_figure, save_figure
from mdrive_sumo.study.cross_play import CrossPlaySummary
from mdrive_sumo.study.penetration import PenetrationLine, PenetrationSummary
from mdrive_sumo.study.plots import SCORES, shade_intervals
from mdrive_sumo.study.two_agents import ALL, DS, OTHER, TESTED

LINE_STYLES = {ALL: "-", TESTED: "--", OTHER: ":"}
DARK_BELOW = 60.0
"""Cells with a lower score [%] have white text."""


def draw_cross_play(summary: CrossPlaySummary, title: str, stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg, a matrix of the mean DS of the CAV under test. Raises InputError."""
    size = 2.5 + 0.95 * len(summary.agents)
    with open_figure(size + 1.2, size) as figure:
        axes = figure.add_subplot()
        axes.grid(visible=False)
        values = [[summary.cells[tested, others][DS].mean for others in summary.agents] for tested in summary.agents]
        image = axes.imshow(values, vmin=0.0, vmax=100.0, cmap="cividis")
        for y, row in enumerate(values):
            for x, value in enumerate(row):
                axes.text(x, y, f"{value:.1f}", ha="center", va="center", color=_choose_ink(value), fontsize=9)
        places = range(len(summary.agents))
        axes.set_xticks(places, summary.agents, rotation=35, ha="right")
        axes.set_yticks(places, summary.agents)
        axes.set(xlabel="agent of the other CAVs", ylabel="agent under test", title=title)
        figure.colorbar(image, label="DS of the CAV under test [%]", shrink=0.8)
        return save_figure(figure, stem)


def draw_penetration(summary: PenetrationSummary, title: str, stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg: DS and SR by role against the penetration, a colour for each agent.

    Raises InputError.
    """
    with open_figure(9.0, 4.4) as figure:
        panels = [figure.add_subplot(1, 2, i + 1) for i in range(2)]
        for axes, (metric, label) in zip(panels, SCORES, strict=True):
            for i, agent in enumerate(dict.fromkeys(line.agent for line in summary.lines)):
                lines = [line for line in summary.lines if line.agent == agent]
                for role in LINE_STYLES:
                    _draw_role(axes, lines, (role, metric), i)
            axes.set(xlabel="CAVs that drive as the agent [%]", ylabel=label, ylim=(-2, 102), xlim=(-2, 102))
        figure.suptitle(title, fontsize="medium")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
        return save_figure(figure, stem)


def _draw_role(axes: Axes, lines: Sequence[PenetrationLine], what: tuple[str, str], i: int) -> None:
    role, metric = what
    found = [(line.penetration, line.score[role][metric]) for line in lines if role in line.score]
    x, colour = [level for level, _ in found], COLOURS[i % len(COLOURS)]
    if role == ALL:
        shade_intervals(axes, x, [value for _, value in found], colour)
    axes.plot(
        x,
        [value.mean for _, value in found],
        color=colour,
        linestyle=LINE_STYLES[role],
        marker=MARKERS[i % len(MARKERS)],
        markersize=5,
        label=f"{lines[0].agent}: {'all CAVs' if role == ALL else 'CAVs ' + role if role == TESTED else 'other CAVs'}",
        clip_on=False,
    )


def _choose_ink(value: float) -> str:
    return "white" if value < DARK_BELOW else "black"
