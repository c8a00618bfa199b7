"""Maps of the report. Roads and tracks are drawn once and referenced by the overview and by every actor's map."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.roads import RoadMap
from real2sim.fidelity_report.html import Markup, MarkupValue, join_markup, tag
from real2sim.fidelity_report.report_entry import ReportEntry
from real2sim.fidelity_report.svg import CM, SvgFrame, ViewBox, fit_view_box, path, picture, scale_bar, use
from real2sim.recording import DEFAULT_SIZE_M, RecordedTrack

MARGIN_M = 12.0
AROUND_M = 60.0
"""[m] Roads are drawn this far beyond the overview, for the small maps at its edge."""
LEAST_M, LEAST_THING_M = 50.0, 24.0
WIDTH_STEP_M = 0.25
ARROWS_M, ARROW_M = 10.0, 0.45
"""[m] Distance between the arrows on a lane, and half their width."""
THUMBNAIL_LANE_M, THUMBNAIL_STEP_M = 3.5, 0.4


@dataclass(frozen=True, slots=True)
class MapFrame:
    """The overview's view and its position on the page."""

    canvas: SvgFrame
    view: ViewBox


def fit_map_frame(things: Sequence[ReportEntry]) -> MapFrame:
    """Return a view of everything that the log shows."""
    places = [thing.xy for thing in things]
    view = fit_view_box(np.concatenate(places) if places else np.zeros((0, 2)), MARGIN_M, LEAST_M)
    return MapFrame(SvgFrame(view.left, view.high), view)


def draw_definitions(plan: MapFrame, roads: RoadMap, things: Sequence[ReportEntry]) -> Markup:
    """Return roads and tracks as invisible definitions for all pictures of the page."""
    drawn = join_markup((_tracks_of(plan.canvas, thing) for thing in things), "\n")
    return tag("svg", tag("defs", _roads(plan, roads), "\n", drawn), class_="definitions", aria_hidden="true")


def _roads(plan: MapFrame, roads: RoadMap) -> Markup:
    canvas, view = plan.canvas, plan.view
    widths: dict[int, list[str]] = {}
    middles: list[str] = []
    arrows: list[str] = []
    for lane in roads.driving:
        if view.near(lane.centre.xy, AROUND_M):
            line = canvas.line(lane.centre.xy)
            widths.setdefault(round(lane.width / WIDTH_STEP_M), []).append(line)
            if not lane.junction:
                middles.append(line)
                arrows.append(_arrows(canvas, lane.centre))
    areas = "".join(canvas.area(outline) for outline in roads.junctions if view.near(outline, AROUND_M))
    walks = "".join(canvas.area(outline) for outline in roads.pavements if view.near(outline, AROUND_M))
    crossings = [(line, width) for line, width in roads.crossings if view.near(line, AROUND_M)]
    return tag(
        "g",
        tag("path", d=walks, class_="walkway") if walks else None,
        *(tag("path", d=canvas.line(line), class_="crossing", stroke_width=f"{w * CM:.0f}") for line, w in crossings),
        tag("path", d=areas, class_="asphalt-area") if areas else None,
        *(_asphalt("".join(lines), steps * WIDTH_STEP_M) for steps, lines in sorted(widths.items())),
        path("".join(middles), class_="middle"),
        path("".join(arrows), class_="arrows"),
        id="roads",
    )


def _arrows(canvas: SvgFrame, line: Polyline) -> str:
    """Return the path of small chevrons along a lane."""
    found = ""
    for s in np.arange(ARROWS_M / 2, line.length, ARROWS_M):
        yaw = line.yaw_at(float(s))
        ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
        tip = np.array(line.at(float(s)))
        found += canvas.line(tip + np.array((left - 1.4 * ahead, 0 * ahead, -left - 1.4 * ahead)) * ARROW_M)
    return found


def _asphalt(d: str, width: float) -> Markup:
    return tag("path", d=d, class_="asphalt", stroke_width=f"{width * CM:.0f}")


def _tracks_of(canvas: SvgFrame, thing: ReportEntry) -> Markup:
    raw, track, known = thing.raw, thing.track, thing.known
    return join_markup(
        (
            path(canvas.dots(raw.xy), id=f"raw-{thing.number}") if raw else None,
            path(canvas.line(track.xy, track.valid), id=f"way-{thing.number}") if track and track.valid.any() else None,
            _box(canvas, known, thing.number) if known and known.valid.any() else None,
        )
    )


def _box(canvas: SvgFrame, track: RecordedTrack, number: int) -> Markup:
    """Return the box where the object is last seen."""
    last = int(track.valid_frames[-1])
    length, width = _size(track, last)
    yaw = float(np.nan_to_num(track.yaw[last]))
    pose = (float(track.x[last]), float(track.y[last]), yaw)
    return path(canvas.vehicle(pose, length, width), id=f"box-{number}")


def _size(track: RecordedTrack, frame: int) -> tuple[float, float]:
    usual = DEFAULT_SIZE_M[track.category]
    length, width = float(track.length[frame]), float(track.width[frame])
    return (length if length > 0 else usual[0], width if width > 0 else usual[1])


def draw_overview(plan: MapFrame, things: Sequence[ReportEntry]) -> Markup:
    """Return the overview: static objects below, failing actors on top, CAVs marked."""
    moving = sorted((thing for thing in reversed(things) if thing.look != "rest"), key=lambda thing: thing.cav)
    still = [thing for thing in things if thing.look == "rest"]
    size = 0.013 * max(plan.view.size) * CM
    return picture(
        f"Map of the log with {len(moving)} tracks and {len(still)} things that stand still",
        plan.canvas.box(plan.view),
        use("roads", "roads"),
        _layer("rest", (_shown(thing, boxes=True) for thing in still)),
        _layer("raw", (use(f"raw-{thing.number}", "raw") for thing in moving if thing.raw)),
        _layer("way", (_shown(thing, boxes=False) for thing in moving)),
        _layer("boxes", (_shown(thing, boxes=True) for thing in moving)),
        _layer("names", (_name(plan.canvas, thing, size) for thing in moving if thing.cav or thing.look == "fail")),
        scale_bar(plan.canvas, plan.view),
        class_="map",
    )


def _layer(name: str, content: Iterable[MarkupValue]) -> Markup:
    return tag("g", *content, class_=f"layer-{name}")


def _shown(thing: ReportEntry, boxes: bool) -> Markup | None:
    """Return the path or the box, which links to the actor's entry. Only the mouse uses this link; the table has links
    for all."""
    there = thing.known is not None and thing.known.valid.any() if boxes else thing.track is not None
    if not there:
        return None
    cav = " cav" if thing.cav else ""
    shape = use(f"{'box' if boxes else 'way'}-{thing.number}", f"{'box' if boxes else 'way'} {thing.look}{cav}")
    verdict = "fails" if thing.actor.failed else "passes"
    words = tag("title", f"No. {thing.number}: {thing.actor.category}, {verdict} ({thing.actor.id})")
    return tag("a", words, shape, href=f"#thing-{thing.number}", tabindex="-1")


def _name(canvas: SvgFrame, thing: ReportEntry, size: float) -> Markup | None:
    known = thing.known
    if known is None or not known.valid.any():
        return None
    last = int(known.valid_frames[-1])
    x, y = canvas.at(np.array([[known.x[last], known.y[last]]]))[0]
    name = f"CAV {thing.number}" if thing.cav else f"{thing.number}"
    look = "cav" if thing.cav else "fail"
    return tag("text", name, x=f"{x + size:.0f}", y=f"{y - size:.0f}", font_size=f"{size:.0f}", class_=f"name {look}")


def draw_actor_map(plan: MapFrame, thing: ReportEntry) -> Markup | None:
    """Return the raw and reconstructed path of one actor with the roads around it."""
    if not len(thing.xy):
        return None
    view = fit_view_box(thing.xy, 4.0, LEAST_THING_M, 0.7)
    n = thing.number
    return picture(
        f"Path of No. {n}: dots are the log, the line is reconstructed",
        plan.canvas.box(view),
        use("roads", "roads"),
        use(f"box-{n}", f"box {thing.look}{' cav' if thing.cav else ''}") if thing.known else None,
        use(f"way-{n}", f"way {thing.look}") if thing.track else None,
        use(f"raw-{n}", "raw") if thing.raw else None,
        scale_bar(plan.canvas, view, words=0.035),
        class_="map small",
    )


def draw_thumbnail(plan: MapFrame, roads: RoadMap, things: Sequence[ReportEntry]) -> Markup:
    """Return a simplified, self-contained overview."""
    lanes = (lane.centre.xy for lane in roads.driving if plan.view.near(lane.centre.xy))
    ways: dict[str, str] = {}
    for thing in things:
        if thing.track is not None and thing.actor.moving:
            look = "cav" if thing.cav and thing.look != "fail" else thing.look
            xy = thing.track.xy[thing.track.valid]
            ways[look] = ways.get(look, "") + plan.canvas.line(_thinned(xy))
    return picture(
        f"Map with {sum(thing.actor.moving for thing in things)} tracks",
        plan.canvas.box(plan.view),
        _asphalt("".join(plan.canvas.line(_thinned(xy)) for xy in lanes), THUMBNAIL_LANE_M),
        *(path(ways[look], class_=f"way {look}") for look in ("walk", "pass", "cav", "fail") if look in ways),
        class_="thumbnail",
    )


def _thinned(xy: Float) -> Float:
    """Return a line (N, 2) with fewer points; a single point stays."""
    if len(xy) < 2:
        return xy
    return shapely.get_coordinates(shapely.simplify(shapely.LineString(xy), THUMBNAIL_STEP_M))


def draw_far_points(canvas: SvgFrame, xy: Float) -> Markup:
    """Return marks where the network deviates from its source."""
    return path(canvas.dots(xy), class_="far")
