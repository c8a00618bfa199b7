"""Figures of a report: categories, differences, distribution of the driving score, scores by scenario."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from textwrap import fill

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mdrive_sumo.core.tables import Table
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.comparison_report.difference_tables import AgentDifference
from mdrive_sumo.report.comparison_report.scenario_tables import compute_agent_levels, compute_distribution
from mdrive_sumo.report.figure_style import COLOURS, open_figure, render_figure
from mdrive_sumo.scoring import compute_harmonic_mean

INK, PAPER, GRID = "#000000", "#ffffff", "#dddddd"
"""Colours of lines and text, background and grid in figures, which a page replaces by its own."""
HATCHES = ("", "///", "...", "xxx")
"""Patterns of bars once all colours are in use."""
WIDTH_IN = 9.0
"""[in] Chosen: figures of one width, which fits a page in landscape."""
MAX_LABELLED_BARS = 24
"""Bars of one figure that have their values beside them: of more, the numbers would touch at `WIDTH_IN`."""
MAX_LABELLED_SCENARIOS = 70
"""Rows of the matrix that have names: the V2XPnP bucket has 67. Of more, a figure would be longer than a page."""
SHADES = "viridis"
"""Colours of scores from 0 to 100, ordered by lightness: they differ in print and for the colour-blind."""
SHADE_STEPS = 20
"""Shades of a heat map: few, because an SVG file holds a picture of points instead of more."""
MAX_LINE = 30
"""Characters of a name in one line: 2.2 inches. Without breaks, names with conditions leave no room for the axes."""
LINE_IN = 0.16
"""[inch] A line of text."""


@dataclass(frozen=True, slots=True)
class ReportFigure:
    """A figure of a report. `name` is the stem of its files."""

    name: str
    title: str
    description: str
    """What it shows, for readers who cannot see it."""
    size_in: tuple[float, float]
    draw: Callable[[Figure], None]

    def render(self, *kinds: str) -> tuple[bytes, ...]:
        """Return the figure as each of `kinds`, "png" or "svg"; the same bytes for the same numbers."""
        with open_figure(*self.size_in) as figure:
            self.draw(figure)
            return tuple(render_figure(figure, kind) for kind in kinds)


def inline_svg(svg: bytes, name: str) -> str:
    """Return an SVG element for a page: in the page's colours, light and dark, with ids that begin with `name`."""
    text = svg.decode("utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for before in ('id="', 'href="#', "url(#"):
        text = text.replace(before, f"{before}{name}-")
    for colour, variable in ((INK, "ink"), (PAPER, "card"), (GRID, "grid")):
        text = text.replace(f": {colour}", f": var(--{variable})")
    return text.strip()


def break_name(name: str) -> str:
    """Return the name of an agent in lines of at most `MAX_LINE` characters; a new line for its conditions."""
    if len(name) <= MAX_LINE:
        return name
    agent, bracket, conditions = name.partition(" (")
    return "\n".join(fill(part, MAX_LINE) for part in (agent, bracket.strip() + conditions) if part)


def _name_difference(difference: AgentDifference) -> str:
    names = break_name(difference.agent), break_name(difference.other)
    return ("\n−  " if any("\n" in name for name in names) else "  −  ").join(names)


def _measure_lines(names: Iterable[str]) -> float:
    """Return the height [inch] of the lines that names have beyond the first, of the one with most."""
    return LINE_IN * max((break_name(name).count("\n") for name in names), default=0)


def make_level_figure(agents: Sequence[ComparedAgent], name: str = "levels") -> ReportFigure | None:
    """Return the category figure, H by interactivity level; None without scenarios of the levels."""
    values = {
        agent.name: {level: compute_harmonic_mean(means) for level, means in compute_agent_levels(agent).items()}
        for agent in agents
    }
    levels = list(values[agents[0].name])
    if not levels:
        return None
    described = "; ".join(
        f"{agent}: {', '.join(f'{level} {value:.1f}' for level, value in value_by_level.items())}"
        for agent, value_by_level in values.items()
    )

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        _draw_bars(
            axes,
            levels,
            {
                break_name(agent): [value_by_level[level] for level in levels]
                for agent, value_by_level in values.items()
            },
        )
        axes.set(ylabel="H, harmonic mean of DS and SR [%]", ylim=(0, 108))
        figure.legend(loc="outside lower center", ncols=min(len(values), 4), frameon=False)

    more_rows = (len(agents) - 1) // 4
    height = 3.6 + 0.25 * more_rows + _measure_lines(values) * (more_rows + 1)
    return ReportFigure(name, "Harmonic mean of DS and SR by interactivity level", described, (WIDTH_IN, height), draw)


def _draw_bars(axes: Axes, groups: Sequence[str], values: dict[str, list[float]]) -> None:
    width = 0.84 / len(values)
    for i, (label, heights) in enumerate(values.items()):
        x = np.arange(len(groups)) - 0.42 + width * (i + 0.5)
        colour, hatch = COLOURS[i % len(COLOURS)], HATCHES[i // len(COLOURS) % len(HATCHES)]
        bars = axes.bar(x, heights, width * 0.92, label=label, color=colour, hatch=hatch, edgecolor="none")
        if len(groups) * len(values) <= MAX_LABELLED_BARS:
            axes.bar_label(bars, fmt="%.1f", padding=1, fontsize=8)
    axes.set_xticks(range(len(groups)), groups)
    axes.grid(axis="x", visible=False)


def make_difference_figure(differences: Sequence[AgentDifference], name: str = "differences") -> ReportFigure | None:
    """Return the paired differences of DS with their intervals; None without any."""
    defined = [difference for difference in differences if difference.ds is not None]
    if not defined:
        return None
    described = "; ".join(
        f"{difference.agent} minus {difference.other}: {difference.ds.mean:+.2f}"
        for difference in defined
        if difference.ds
    )
    lines_in = LINE_IN * max(_name_difference(difference).count("\n") for difference in defined)
    size = (WIDTH_IN, 1.2 + (0.3 + lines_in) * len(defined))
    return ReportFigure(
        name, "Paired differences of the driving score", described, size, partial(_draw_differences, defined)
    )


def _draw_differences(differences: Sequence[AgentDifference], figure: Figure) -> None:
    axes = figure.add_subplot()
    axes.axvline(0, color="#000000", linewidth=0.8)
    for i, difference in enumerate(differences):
        if difference.ds is None:
            continue
        if difference.ds.ends is not None:
            axes.plot(difference.ds.ends, [i, i], color=COLOURS[0], linewidth=2.2, solid_capstyle="butt")
        face = COLOURS[0] if difference.ds.is_clear else "#ffffff"
        axes.plot(difference.ds.mean, i, "o", color=COLOURS[0], markerfacecolor=face, markersize=6)
    axes.set_yticks(range(len(differences)), [_name_difference(difference) for difference in differences])
    axes.set(xlabel="difference of DS [percentage points], 95 % interval; filled: without 0")
    axes.set_ylim(len(differences) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)


def make_distribution_figure(agents: Sequence[ComparedAgent], name: str = "distribution") -> ReportFigure:
    """Return the share of episodes in each class of driving score, a bar for each agent."""
    shares = {agent.name: compute_distribution(agent.results.scenarios) for agent in agents}
    described = "; ".join(
        f"{agent}: {', '.join(f'{label} {share:.0f} %' for label, share in share_by_label.items())}"
        for agent, share_by_label in shares.items()
    )

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        labels = list(next(iter(shares.values())))
        left = np.zeros(len(shares))
        for i, label in enumerate(labels):
            widths = np.array([share_by_label[label] for share_by_label in shares.values()])
            bars = axes.barh(
                [break_name(agent) for agent in shares],
                widths,
                left=left,
                height=0.7,
                label=label,
                color=pick_shade(i, len(labels)),
            )
            texts = [f"{width:.0f}" if width >= 4 else "" for width in widths]
            light = i >= len(labels) // 2
            axes.bar_label(bars, texts, label_type="center", fontsize=8, color="#111111" if light else "#fefefe")
            left += widths
        axes.invert_yaxis()
        axes.set(xlabel="share of the episodes [%]", xlim=(0, 100))
        axes.grid(axis="y", visible=False)
        figure.legend(loc="outside lower center", ncols=len(labels), frameon=False, title="driving score DS")

    size = (WIDTH_IN, 1.7 + (0.36 + _measure_lines(shares)) * len(agents))
    return ReportFigure(name, "Distribution of the driving score", described, size, draw)


def pick_shade(i: int, count: int) -> str:
    """Return the colour of class i of `count`, from the lowest scores to the highest."""
    red, green, blue, _ = colormaps[SHADES](i / max(1, count - 1))
    return "#" + "".join(f"{round(255 * part):02x}" for part in (red, green, blue))


def make_scenario_figure(table: Table, name: str = "scenarios") -> ReportFigure:
    """Return the matrix agents x scenarios as a heat map. table: of `build_scenario_table`."""
    agents = [column.label for column in table.columns[2:]]
    numbers = [[np.nan if cell.number is None else cell.number for cell in row.cells[2:]] for row in table.rows]
    names = [str(row.cells[0].value) for row in table.rows]
    sections = [row.section for row in table.rows]

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        places = np.arange(len(agents) + 1) - 0.5, np.arange(len(names) + 1) - 0.5
        shades = colormaps[SHADES].resampled(SHADE_STEPS)
        mesh = axes.pcolormesh(
            *places, np.array(numbers), cmap=shades, vmin=0, vmax=100, edgecolors="face", linewidth=0.4
        )
        axes.invert_yaxis()
        axes.set_xticks(range(len(agents)), map(break_name, agents), rotation=30, ha="right", rotation_mode="anchor")
        starts = [i for i, section in enumerate(sections) if i == 0 or section != sections[i - 1]]
        for start in starts[1:]:
            axes.axhline(start - 0.5, color="#ffffff", linewidth=2)
        if len(names) <= MAX_LABELLED_SCENARIOS:
            axes.set_yticks(range(len(names)), names, fontsize=7)
        else:
            axes.set_yticks(starts, [sections[start] for start in starts])
        axes.grid(visible=False)
        figure.colorbar(mesh, ax=axes, label=table.title.partition(" ")[0] + " [%]", shrink=0.8)

    row_in = 0.17 if len(names) <= MAX_LABELLED_SCENARIOS else 0.05
    return ReportFigure(
        name,
        table.title,
        "A row for each scenario, a column for each agent; the numbers are in the table.",
        (min(WIDTH_IN, 4.0 + 0.7 * len(agents)), 1.6 + row_in * len(names) + 2 * _measure_lines(agents)),
        draw,
    )
