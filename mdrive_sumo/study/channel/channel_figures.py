"""Pictures of the study of channels: a panel for each run, the axes shared."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mdrive_sumo.core.state import DT
from mdrive_sumo.report.figure_style import COLOURS, MARKERS, open_figure, save_figure
from mdrive_sumo.study.channel.channel_files import sum_counts
from mdrive_sumo.study.channel.channel_study import RunMeasures
from mdrive_sumo.study.channel.link_measures import RING_M, Counts, LinkGroup, list_link_classes

MIN_SHOWN = 30
"""Rings with fewer pairs are not drawn: 30 with half of them received have a standard error of 9 points."""
PANELS_PER_ROW = 3
LEAST_TOP_PERCENT = 1.0
"""Of the axis of busy ratios: an idle channel has an axis, too."""
PERCENT_TICKS = (0.1, 1, 10, 100)
"""On the logarithmic axes of gaps and ages, down to a thousandth."""


def draw_reception(measured: Sequence[RunMeasures], stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg: the packet reception ratio over distance, a colour for each class of links."""
    classes = list_link_classes(ring.group for run in measured for ring in run.links.transmitted)

    def draw(axes: Axes, run: RunMeasures) -> None:
        for i, link_class in enumerate(classes):
            rings = sorted({ring.number for ring in run.links.transmitted if ring.group.link_class == link_class})
            points = [(ring, *_count_ring(run, link_class, ring)) for ring in rings]
            shown = [(ring, received / count) for ring, count, received in points if count >= MIN_SHOWN]
            if not shown:
                continue  # the layout fails for a line without points
            axes.plot(
                [(ring + 0.5) * RING_M for ring, _ in shown],
                [100 * ratio for _, ratio in shown],
                color=COLOURS[i % len(COLOURS)],
                marker=MARKERS[i % len(MARKERS)],
                markersize=4,
                label="all links" if classes == ["any"] else link_class,
                clip_on=False,
            )
        axes.set(xlabel="distance [m]", ylabel="received [%]", ylim=(-2, 102))

    return _draw_panels(measured, draw, "Packet reception ratio over distance", stem)


def _count_ring(run: RunMeasures, link_class: str, number: int) -> tuple[int, int]:
    """Return how many pairs of a message and a receiver a ring has, and how many were received."""
    of_ring = [r for r in run.links.transmitted if (r.group.link_class, r.number) == (link_class, number)]
    return sum(run.links.transmitted[r] for r in of_ring), sum(run.links.received[r] for r in of_ring)


def draw_gaps(measured: Sequence[RunMeasures], stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg: the share of gaps between receptions that are longer, a colour for each type."""
    title = "Inter-packet gap: time between two receptions from a sender"
    return _draw_tails(measured, lambda run: run.links.gaps, ("gap [s]", "gaps that are longer"), title, stem)


def draw_ages(measured: Sequence[RunMeasures], stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg: the share of time in which information is older, a colour for each type."""
    title = "Age of information: time since the newest received message was sent"
    return _draw_tails(measured, lambda run: run.links.ages, ("age [s]", "time in which it is older"), title, stem)


def _draw_tails(
    measured: Sequence[RunMeasures],
    get_times: Callable[[RunMeasures], Mapping[LinkGroup, Counts]],
    labels: tuple[str, str],
    title: str,
    stem: Path,
) -> tuple[Path, Path]:
    types = sorted({group.message_type for run in measured for group in get_times(run)})

    def draw(axes: Axes, run: RunMeasures) -> None:
        for i, message_type in enumerate(types):
            counts = sum_counts(get_times(run), message_type=message_type)
            if not counts.sum():
                continue
            longer = 100 - 100 * np.cumsum(counts) / counts.sum()
            times = np.arange(len(counts)) * DT
            axes.step(times, longer, where="post", color=COLOURS[i % len(COLOURS)], label=message_type.upper())
        axes.set_yscale("log")
        axes.set_yticks(PERCENT_TICKS, [f"{percent:g}" for percent in PERCENT_TICKS])
        axes.set(xlabel=labels[0], ylabel=f"{labels[1]} [%]", ylim=(PERCENT_TICKS[0], 130))

    return _draw_panels(measured, draw, title, stem)


def draw_busy(measured: Sequence[RunMeasures], stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg: the channel busy ratio over the time of episodes, its mean and its spread."""

    highest = max(load.high for run in measured for load in run.loads.list_seconds())

    def draw(axes: Axes, run: RunMeasures) -> None:
        loads = run.loads.list_seconds()
        if not loads:
            return
        times = [load.second + 0.5 for load in loads]
        low, high = ([100 * end for end in ends] for ends in zip(*((one.low, one.high) for one in loads), strict=True))
        axes.fill_between(times, low, high, color=COLOURS[0], alpha=0.15, lw=0, label="nine of ten stations")
        axes.plot(times, [100 * load.mean for load in loads], color=COLOURS[0], label="mean over stations and episodes")
        axes.set(xlabel="time since the start of the episode [s]", ylabel="channel busy ratio [%]")
        axes.set_ylim(0, max(110 * highest, LEAST_TOP_PERCENT))

    return _draw_panels(measured, draw, "Channel busy ratio over time", stem)


def draw_awareness(measured: Sequence[RunMeasures], stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg: known road users over distance, by own sensors and with messages."""

    def draw(axes: Axes, run: RunMeasures) -> None:
        found = run.awareness
        rings = [ring for ring in sorted(found.relevant) if found.relevant[ring] >= MIN_SHOWN]
        lines = ((found.known, "own sensors and messages", "-"), (found.seen, "own sensors", "--"))
        for i, (counts, label, style) in enumerate(lines if rings else ()):
            axes.plot(
                [(ring + 0.5) * RING_M for ring in rings],
                [100 * counts[ring] / found.relevant[ring] for ring in rings],
                color=COLOURS[i],
                marker=MARKERS[i],
                markersize=4,
                linestyle=style,
                label=label,
                clip_on=False,
            )
        axes.set(xlabel="distance from the CAV [m]", ylabel="road users known [%]", ylim=(-2, 102))

    return _draw_panels(measured, draw, "Environmental awareness ratio over distance", stem)


def _draw_panels(
    measured: Sequence[RunMeasures], draw: Callable[[Axes, RunMeasures], None], title: str, stem: Path
) -> tuple[Path, Path]:
    columns = min(len(measured), PANELS_PER_ROW)
    rows = -(-len(measured) // columns)
    with open_figure(1.0 + 4.2 * columns, 0.8 + 3.2 * rows) as figure:
        panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
        for axes, run in zip(panels, measured, strict=False):
            draw(axes, run)
            axes.set_title(run.name, fontsize="medium")
            if not axes.lines:
                axes.text(0.5, 0.5, "too few to draw", transform=axes.transAxes, ha="center", color="#5c6673")
        farthest = [max(line.get_xdata()) for axes in panels for line in axes.lines]
        panels[0].set_xlim(0, 1.04 * max(farthest, default=RING_M))  # the panels share it
        for axes in panels[len(measured) :]:
            axes.set_axis_off()
        figure.suptitle(title, fontsize="medium")
        _add_legend(figure)
        return save_figure(figure, stem)


def _add_legend(figure: Figure) -> None:
    handles = {
        label: handle for axes in figure.axes for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if handles:
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, frameon=False)
