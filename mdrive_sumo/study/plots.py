"""Pictures of studies: scores against a factor of the channel or the penetration, the matrix of cross-play."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes

from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.report.figure_style import COLOURS, MARKERS, open_figure, save_figure
from mdrive_sumo.study.conditions import ChannelCondition, ChannelFactor, Level
from mdrive_sumo.study.cross_play import CrossPlaySummary
from mdrive_sumo.study.penetration import PenetrationLine, PenetrationSummary
from mdrive_sumo.study.study_summary import StudyLine
from mdrive_sumo.study.twins import TwinSummary
from mdrive_sumo.study.two_agents import ALL, DS, OTHER, TESTED

SCORES = (("ds", "driving score DS [%]"), ("sr", "success rate SR [%]"))
LINE_STYLES = {ALL: "-", TESTED: "--", OTHER: ":"}
DARK_BELOW = 60.0
"""Cells with a lower score [%] have white text."""


@dataclass(frozen=True, slots=True)
class FactorCurve:
    """One agent's lines of the table along a factor, by level; `off`: its line with the channel off."""

    agent: str
    lines: Mapping[Level, StudyLine]
    off: StudyLine | None


def make_curves(lines: Sequence[StudyLine], factor: ChannelFactor, base: ChannelCondition) -> tuple[FactorCurve, ...]:
    """Return a curve for every agent with two levels or more while the other factors are the base channel's."""
    agents = dict.fromkeys(line.row.agent for line in lines)
    curves = (_make_curve([line for line in lines if line.row.agent == agent], factor, base) for agent in agents)
    return tuple(curve for curve in curves if len(curve.lines) > 1)


def _make_curve(lines: Sequence[StudyLine], factor: ChannelFactor, base: ChannelCondition) -> FactorCurve:
    line_by_level: dict[Level, StudyLine] = {}
    for line in lines:
        condition = line.row.condition
        level = factor.of(base.comm) if condition.name == base.name else condition.levels.get(factor.name)
        if level is not None and set(condition.levels) <= {factor.name}:
            line_by_level[level] = line
    off = next((line for line in lines if line.row.condition.name == "off" and not line.row.reused), None)
    return FactorCurve(lines[0].row.agent, dict(sorted(line_by_level.items())), off)


def draw_curves(curves: Sequence[FactorCurve], factor: ChannelFactor, title: str, stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg, the same bytes for the same numbers, and return the paths. Raises InputError."""
    places = _place_levels({level for curve in curves for level in curve.lines})
    with open_figure(9.0, 4.2) as figure:
        panels = [figure.add_subplot(1, 2, i + 1) for i in range(2)]
        for axes, (name, label) in zip(panels, SCORES, strict=True):
            for i, curve in enumerate(curves):
                _draw_curve(axes, curve, (name, places), i)
            axes.set(xlabel=factor.axis, ylabel=label, ylim=(-2, 102))
            axes.set_xticks(list(places.values()), [_format_tick(level) for level in places])
        figure.suptitle(title, fontsize="medium")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4), frameon=False)
        return save_figure(figure, stem)


def _place_levels(levels: Collection[Level]) -> dict[Level, float]:
    """Return the place of each level on the axis: its first number, or evenly spaced if that is not unique."""
    order = sorted(levels)
    unique = len({level[0] for level in order}) == len(order)
    return {level: level[0] if unique else float(i) for i, level in enumerate(order)}


def _format_tick(level: Level) -> str:
    """Return the label of a level; of a pose error both numbers if they differ."""
    same = len(set(level)) == 1
    return f"{level[0]:g}" if same else f"{level[0]:g} m\n{level[1]:g}°"


def _draw_curve(axes: Axes, curve: FactorCurve, what: tuple[str, Mapping[Level, float]], i: int) -> None:
    name, places = what
    colour, marker = COLOURS[i % len(COLOURS)], MARKERS[i % len(MARKERS)]
    points = [(places[level], value) for level, line in curve.lines.items() if (value := _get_interval(line, name))]
    x, values = [place for place, _ in points], [value for _, value in points]
    shade_intervals(axes, x, values, colour)
    silent = any(line.row.reused for line in curve.lines.values())
    label = curve.agent + (" (no messages)" if silent else "")
    width = max(2.6 - 0.5 * i, 1.2)  # later curves are thinner: where curves coincide all of them are seen
    axes.plot(
        x,
        [v.mean for v in values],
        color=colour,
        marker=marker,
        markersize=5 * width**0.5,
        linestyle="--" if silent else "-",
        linewidth=width,
        label=label,
        clip_on=False,
    )
    if curve.off and (value := _get_interval(curve.off, name)):
        axes.axhline(value.mean, color=colour, linestyle=":", label=f"{curve.agent}, channel off")


def shade_intervals(axes: Axes, x: Sequence[float], values: Sequence[ConfidenceInterval], colour: str) -> None:
    """Shade the intervals at the places x; nothing where one is over too few scenarios."""
    ends = [value.ends for value in values]
    bounds = [pair for pair in ends if pair is not None]
    if len(bounds) == len(ends):
        axes.fill_between(x, [low for low, _ in bounds], [high for _, high in bounds], color=colour, alpha=0.15, lw=0)


def _get_interval(line: StudyLine, name: str) -> ConfidenceInterval | None:
    return line.ds if name == "ds" else line.sr


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
    points = [(line.penetration, line.score[role][metric]) for line in lines if role in line.score]
    x, colour = [level for level, _ in points], COLOURS[i % len(COLOURS)]
    if role == ALL:
        shade_intervals(axes, x, [value for _, value in points], colour)
    axes.plot(
        x,
        [value.mean for _, value in points],
        color=colour,
        linestyle=LINE_STYLES[role],
        marker=MARKERS[i % len(MARKERS)],
        markersize=5,
        label=f"{lines[0].agent}: {'all CAVs' if role == ALL else 'CAVs ' + role if role == TESTED else 'other CAVs'}",
        clip_on=False,
    )


def draw_twins(summary: TwinSummary, title: str, stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg: the change of DS by factor, a colour for each agent. Raises InputError."""
    factors = list(dict.fromkeys(line.factor for line in summary.lines))
    agents = list(dict.fromkeys(line.agent for line in summary.lines))
    with open_figure(8.0, 1.6 + 0.9 * len(factors)) as figure:
        axes = figure.add_subplot()
        axes.axvline(0.0, color="#5c6673", linewidth=0.8)
        for i, agent in enumerate(agents):
            offset = 0.6 * ((i + 0.5) / len(agents) - 0.5)
            known = [
                (factors.index(line.factor) + offset, line.change[DS]) for line in summary.lines if line.agent == agent
            ]
            colour = COLOURS[i % len(COLOURS)]
            for place, change in known:
                if change.ends:
                    axes.plot(change.ends, (place, place), color=colour, linewidth=1.5)
            axes.plot(
                [change.mean for _, change in known],
                [place for place, _ in known],
                color=colour,
                linestyle="",
                marker=MARKERS[i % len(MARKERS)],
                markersize=5,
                label=agent,
            )
        has_ends = any(line.change[DS].ends for line in summary.lines)
        axes.set_yticks(range(len(factors)), factors)
        axes.set_ylim(len(factors) - 0.5, -0.5)
        axes.grid(visible=False, axis="y")
        for i in range(len(factors) - 1):
            axes.axhline(i + 0.5, color="#bbbbbb", linewidth=0.6)
        axes.set(
            xlabel=f"DS of the twin - DS of the original [points]{', with 95 % intervals' if has_ends else ''}",
            ylabel="changed in the twin",
            title=f"{title}: what each factor costs",
        )
        figure.legend(loc="outside lower center", ncols=min(len(agents), 4), frameon=False)
        return save_figure(figure, stem)


def _choose_ink(value: float) -> str:
    return "white" if value < DARK_BELOW else "black"
