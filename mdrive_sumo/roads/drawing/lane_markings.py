"""Compute the lane markings of a network for pictures: edge lines, double centre lines and dividers, as smooth lines.

The lanes of a converted log have constant widths, end where the source's segments end, and overlap where the source's
lanes do. Drawn one by one, their borders give double lines, kinks and fragments. Here borders that face each other
become one marking, pieces that continue each other become one line, and fragments are left out. Networks whose lanes
fit exactly keep their borders.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.roads import Lane
from mdrive_sumo.roads.drawing.line_joining import join_lines, smooth_line

SPACING_M = 1.0
"""[m] Distance between the samples of a border."""
INSET_M = 0.12
"""[m] Solid lines lie this far inside their lane; the two lines of a double one are twice this apart."""
MAX_GAP_M = 1.3
"""[m] Borders that are farther apart have ground or a median between them."""
MAX_OVERLAP_M = 1.2
"""[m] Lanes that overlap more than this merge or diverge: there is no line between them."""
MAX_STAGGER_M = 0.75
"""[m] Samples that face each other lie at most this far apart along the border."""
FACING_COS = -0.85
"""Largest cosine between the outward normals of borders that face each other."""
MAX_INSIDE_M = 0.6
"""[m] Edge lines farther inside the asphalt have other asphalt beyond them: lanes merge or cross there."""
HIDDEN_DEPTH_M = 0.7
"""[m] Markings this deep inside another lane are not drawn."""
MIN_LINE_M = 4.0
"""[m] Shorter markings are fragments of the source's segments."""
MIN_RUN = 3
"""Fewer samples of one kind between two runs of another kind take its kind."""


class MarkingKind(IntEnum):
    """Kind of a marking at one sample of a border."""

    HIDDEN = 0
    EDGE = 1
    """Solid; beyond it there is no lane."""
    CENTRE = 2
    """One of two solid lines; oncoming traffic beyond them."""
    DIVIDER = 3
    """Dashed, between lanes of one direction."""


@dataclass(frozen=True)
class LaneMarkings:
    """Lines (N, 2) [m]."""

    solid: tuple[Float, ...]
    dashed: tuple[Float, ...]


@dataclass(frozen=True)
class _Borders:
    """Samples of both borders of all lanes; arrays (S,) or (S, 2)."""

    xy: Float
    normal: Float
    """Unit vector away from the lane."""
    lane: Int
    side: Int
    """1: left, -1: right border."""

    @property
    def tangent(self) -> Float:
        """Unit vector in the lane's direction."""
        return np.column_stack((self.normal[:, 1], -self.normal[:, 0])) * self.side[:, None]


@dataclass(frozen=True)
class _Facing:
    """The nearest facing border of every sample (S,)."""

    lane: Int
    """-1: none."""
    gap: Float
    """[m], negative where lanes overlap; 0 where there is none."""
    is_oncoming: Bool


def compute_lane_markings(lanes: Sequence[Lane], bare: BaseGeometry, asphalt: BaseGeometry) -> LaneMarkings:
    """Return the markings of lanes outside junctions on asphalt; none within `bare`, the area of the junctions."""
    if not lanes:
        return LaneMarkings((), ())
    borders = _sample_borders(lanes)
    facing = _find_facing(borders)
    kinds = _choose_kinds(borders, facing)
    hidden = _find_inside(borders, kinds, bare, asphalt) | _find_overlapped(borders, facing, lanes)
    kinds[hidden] = MarkingKind.HIDDEN
    shift = np.where(facing.lane >= 0, facing.gap / 2, 0.0) - np.where(kinds == MarkingKind.DIVIDER, 0.0, INSET_M)
    xy = borders.xy + borders.normal * shift[:, None]
    pieces = {kind: [xy[run] for run in _split_runs(borders, kinds, kind)] for kind in MarkingKind}
    solid = (*_finish(pieces[MarkingKind.EDGE]), *_finish(pieces[MarkingKind.CENTRE]))
    return LaneMarkings(solid, tuple(_finish(pieces[MarkingKind.DIVIDER])))


def _finish(pieces: list[Float]) -> Iterator[Float]:
    for line in join_lines(pieces):
        if shapely.LineString(line).length >= MIN_LINE_M:
            yield smooth_line(line)


def _sample_borders(lanes: Sequence[Lane]) -> _Borders:
    parts: list[tuple[Float, Float, Int, Int]] = []
    for number, lane in enumerate(lanes):
        count = max(2, 1 + int(np.ceil(lane.centre.length / SPACING_M)))
        line = shapely.LineString(lane.centre.xy)
        centre = shapely.get_coordinates(line.interpolate(np.linspace(0.0, 1.0, count), normalized=True))
        ahead = np.gradient(centre, axis=0)
        ahead /= np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-9)[:, None]
        left = np.column_stack((-ahead[:, 1], ahead[:, 0]))
        for side in (1, -1):
            normal = left * side
            parts.append(
                (centre + normal * lane.width / 2, normal, np.full(count, number), np.full(count, side, dtype=np.int64))
            )
    xy, normal, lane_number, sides = (np.concatenate(column) for column in zip(*parts, strict=True))
    return _Borders(xy, normal, lane_number, sides)


def _find_facing(borders: _Borders) -> _Facing:
    points = np.asarray(shapely.points(borders.xy), dtype=object)
    reach = float(np.hypot(MAX_GAP_M, MAX_STAGGER_M))
    here, there = shapely.STRtree(points).query(points, predicate="dwithin", distance=reach)
    step = borders.xy[there] - borders.xy[here]
    gap = (step * borders.normal[here]).sum(1)
    stagger = np.abs((step * borders.tangent[here]).sum(1))
    fits = (
        (borders.lane[here] != borders.lane[there])
        & ((borders.normal[here] * borders.normal[there]).sum(1) < FACING_COS)
        & (stagger <= MAX_STAGGER_M)
        & (gap <= MAX_GAP_M)
        & (gap >= -MAX_OVERLAP_M)
    )
    here, there, gap, stagger = here[fits], there[fits], gap[fits], stagger[fits]
    order = np.lexsort((there, np.abs(gap) + 0.3 * stagger, here))
    first = order[np.unique(here[order], return_index=True)[1]]
    lane, gaps = np.full(len(borders.xy), -1), np.zeros(len(borders.xy))
    lane[here[first]], gaps[here[first]] = borders.lane[there[first]], gap[first]
    oncoming = np.zeros(len(borders.xy), dtype=np.bool_)
    oncoming[here[first]] = (borders.tangent[here[first]] * borders.tangent[there[first]]).sum(1) < 0
    return _Facing(lane, gaps, oncoming)


def _choose_kinds(borders: _Borders, facing: _Facing) -> Int:
    divides = np.where(borders.side > 0, MarkingKind.DIVIDER, MarkingKind.HIDDEN)  # one line, by the lane to its right
    kinds = np.where(facing.is_oncoming, MarkingKind.CENTRE, divides)
    return np.asarray(np.where(facing.lane < 0, MarkingKind.EDGE, kinds), dtype=np.int64)


def _find_inside(borders: _Borders, kinds: Int, bare: BaseGeometry, asphalt: BaseGeometry) -> Bool:
    """Return whether samples (S,) lie in a junction, or edge lines away from the edge of the asphalt."""
    shapely.prepare(bare)
    kerb = shapely.boundary(asphalt)
    shapely.prepare(kerb)
    points = np.asarray(shapely.points(borders.xy), dtype=object)
    inside = shapely.contains_xy(bare, borders.xy[:, 0], borders.xy[:, 1])
    return inside | ((kinds == MarkingKind.EDGE) & ~shapely.dwithin(points, kerb, MAX_INSIDE_M))


def _find_overlapped(borders: _Borders, facing: _Facing, lanes: Sequence[Lane]) -> Bool:
    """Return whether samples (S,) lie deep inside a lane that is neither their own nor the one that they face."""
    depth = np.array([max(lane.width / 2 - HIDDEN_DEPTH_M, 0.1) for lane in lanes])
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in lanes], dtype=object)
    points = np.asarray(shapely.points(borders.xy), dtype=object)
    sample, other = shapely.STRtree(lines).query(points, predicate="dwithin", distance=float(depth.max()))
    deep = shapely.distance(points[sample], lines[other]) < depth[other]
    deep &= (other != borders.lane[sample]) & (other != facing.lane[sample])
    overlapped = np.zeros(len(points), dtype=np.bool_)
    overlapped[sample[deep]] = True
    return overlapped


def _split_runs(borders: _Borders, kinds: Int, kind: MarkingKind) -> Iterator[slice]:
    """Yield runs of at least two samples of a kind on one border, without those of the lanes' short gaps."""
    breaks = np.flatnonzero((np.diff(borders.lane) != 0) | (np.diff(borders.side) != 0)) + 1
    bounds = [0, *breaks.tolist(), len(kinds)]
    for begin, end in pairwise(bounds):
        marked = _fill_short_runs(kinds[begin:end]) == kind
        edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])).astype(np.int8)))
        for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            if last - first > 1:
                yield slice(begin + first, begin + last)


def _fill_short_runs(kinds: Int) -> Int:
    """Return kinds (N,) where runs of fewer than `MIN_RUN` between equal ones took their kind."""
    bounds = [0, *(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(kinds)]
    filled = kinds.copy()
    for begin, end in pairwise(bounds[1:-1]):
        if end - begin < MIN_RUN and filled[begin - 1] == kinds[end] != MarkingKind.HIDDEN:
            filled[begin:end] = kinds[end]
    return filled
