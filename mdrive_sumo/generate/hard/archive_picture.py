"""Pictures of the archives of a search: a panel for each cell of the last descriptor, a square for each elite."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import fmean

from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Rectangle

from mdrive_sumo.generate.hard.archive_file import ArchiveDescriptor, ArchiveElite, FamilyArchive, HardArchiveFile
from mdrive_sumo.report.figure_style import open_figure, save_figure

COLOURS = "viridis"
DARK_BELOW = 55.0
"""Gap below which the colour is so dark that text on it is white."""
LEGEND = "number: gap (mean where several)   ●: certificate of need holds, of so many   frame: in the suite"
ALL_FAMILIES = "archive"
"""Stem of the picture over all families."""


def draw_archives(content: HardArchiveFile, folder: Path) -> tuple[Path, ...]:
    """Write a picture over all families and one of each family, as PNG and SVG; return the paths. Raises InputError."""
    everything = [elite for archive in content.families for elite in archive.elites]
    title = f"{len(everything)} elites of {len(content.families)} families"
    paths = [*_draw_elites(everything, content.descriptors, title, folder / ALL_FAMILIES)]
    for archive in content.families:
        stem = folder / f"{ALL_FAMILIES}-{archive.family}"
        paths += _draw_elites(archive.elites, content.descriptors, _describe_archive(archive), stem)
    return tuple(paths)


def _describe_archive(archive: FamilyArchive) -> str:
    return f"{archive.family}: {len(archive.elites)} elites of {archive.evaluated} candidates"


def _draw_elites(
    elites: Iterable[ArchiveElite], descriptors: Sequence[ArchiveDescriptor], title: str, stem: Path
) -> tuple[Path, Path]:
    by_cell: dict[tuple[int, ...], list[ArchiveElite]] = {}
    for elite in elites:
        by_cell.setdefault(elite.cell, []).append(elite)
    panels = len(descriptors[2].edges) - 1
    with open_figure(2.6 * panels + 1.2, 4.6) as figure:
        grid = [figure.add_subplot(1, panels, i + 1) for i in range(panels)]
        for i, axes in enumerate(grid):
            _set_axes(axes, descriptors, i)
            for cell, here in by_cell.items():
                if cell[2] == i:
                    _draw_cell(axes, cell, here)
        scale = ScalarMappable(Normalize(0, 100), COLOURS)
        figure.colorbar(scale, ax=grid, label="gap to omniscient [points]", shrink=0.8)
        figure.suptitle(title)
        figure.supxlabel(LEGEND, size=8)
        return save_figure(figure, stem)


def _set_axes(axes: Axes, descriptors: Sequence[ArchiveDescriptor], panel: int) -> None:
    across, up, over = descriptors
    axes.set(xlim=(0, len(across.edges) - 1), ylim=(0, len(up.edges) - 1), aspect="equal")
    axes.set_xticks(range(len(across.edges)), [f"{edge:.0f}" for edge in across.edges])
    axes.set_yticks(range(len(up.edges)), [f"{edge:g}" for edge in up.edges])
    axes.set_xlabel(_format_name(across))
    if panel == 0:
        axes.set_ylabel(_format_name(up))
    low, high = over.edges[panel : panel + 2]
    axes.set_title(f"{over.name}\n{low:g} to {high:g} {over.unit}", size=9)


def _format_name(descriptor: ArchiveDescriptor) -> str:
    return f"{descriptor.name} [{descriptor.unit}]" if descriptor.unit else descriptor.name


def _draw_cell(axes: Axes, cell: tuple[int, ...], here: Sequence[ArchiveElite]) -> None:
    gap = fmean(elite.gap for elite in here)
    colour = colormaps[COLOURS](gap / 100.0)
    chosen = any(elite.is_chosen for elite in here)
    x, y = cell[:2]
    edge, width = ("#D55E00", 2.0) if chosen else ("white", 0.5)
    axes.add_patch(Rectangle((x + 0.04, y + 0.04), 0.92, 0.92, facecolor=colour, edgecolor=edge, linewidth=width))
    certified = sum(elite.is_certified for elite in here)
    text = f"{gap:.0f}" + (" ●" if certified else "")
    if len(here) > 1:
        text += f"\n{certified} of {len(here)}" if certified else f"\nof {len(here)}"
    axes.text(x + 0.5, y + 0.5, text, ha="center", va="center", size=7, color="white" if gap < DARK_BELOW else "black")
