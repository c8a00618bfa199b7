"""Maps of the report. Roads and tracks are drawn once and referenced by the overview and by every actor's map."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.report.label_placement import LabelBox, LabelRequest, place_labels
from mdrive_sumo.report.map_view import MapView, fit_view
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.drawing.map_geometry import build_map_geometry
from real2sim.fidelity_report.html import Markup, MarkupValue, join_markup, tag
from real2sim.fidelity_report.report_entry import ReportEntry
from real2sim.fidelity_report.svg import (
    CM,
    SvgFrame,
    render_path,
    render_picture,
    render_scale_bar,
    render_use,
)
from real2sim.recording import DEFAULT_SIZE_M, RecordedTrack

MARGIN_M = 12.0
AROUND_M = 60.0
"""[m] Roads are drawn this far beyond the overview, for the small maps at its edge."""
LEAST_M, LEAST_THING_M = 50.0, 24.0
ARROWS_M, ARROW_M = 10.0, 0.45
"""[m] Distance between the arrows on a lane, and half their width."""
NAME_ASPECT = 0.66
"""Mean width of a letter relative to its height."""
THUMBNAIL_LANE_M, THUMBNAIL_STEP_M = 3.5, 0.4


@dataclass(frozen=True, slots=True)
class MapFrame:
    """The overview's view and its position on the page."""

    svg_frame: SvgFrame
    view: MapView


def fit_map_frame(entries: Sequence[ReportEntry]) -> MapFrame:
    """Return a view of everything that the log shows."""
    places = [entry.xy for entry in entries]
    view = fit_view(np.concatenate(places) if places else np.zeros((0, 2)), MARGIN_M, LEAST_M, 0.5)
    return MapFrame(SvgFrame(view.left, view.high), view)


def draw_definitions(map_frame: MapFrame, roads: RoadMap, entries: Sequence[ReportEntry]) -> Markup:
    """Return roads and tracks as invisible definitions for all pictures of the page."""
    drawn = join_markup((_draw_tracks(map_frame.svg_frame, entry) for entry in entries), "\n")
    return tag("svg", tag("defs", _draw_roads(map_frame, roads), "\n", drawn), class_="definitions", aria_hidden="true")


def _draw_roads(map_frame: MapFrame, roads: RoadMap) -> Markup:
    """Return the roads with the geometry of all pictures of the network, and an arrow along every lane."""
    svg, view = map_frame.svg_frame, map_frame.view
    area = shapely.box(view.left, view.low, view.right, view.high).buffer(AROUND_M, join_style="mitre")
    geometry = build_map_geometry(roads, area)
    lanes = (lane for lane in roads.driving if not lane.junction and view.is_near(lane.centre.xy, AROUND_M))
    surfaces = (
        ("walkway", geometry.pavements),
        ("apron", geometry.aprons),
        ("asphalt-area", geometry.asphalt),
        ("stripes", geometry.stripes),
    )
    markings = (("solid", geometry.markings.solid), ("dashed", geometry.markings.dashed))
    return tag(
        "g",
        *(tag("path", d=_areas_path(svg, shapes), class_=look) for look, shapes in surfaces if shapes),
        *(render_path("".join(map(svg.line_path, lines)), class_=look) for look, lines in markings if lines),
        render_path("".join(_arrow_path(svg, lane.centre) for lane in lanes), class_="arrows"),
        id="roads",
    )


def _areas_path(svg: SvgFrame, shapes: Iterable[shapely.Polygon]) -> str:
    """Return the path of areas; outlines turn one way, holes the other way."""
    rings = (ring for shape in map(orient, shapes) for ring in (shape.exterior, *shape.interiors))
    return "".join(svg.area_path(shapely.get_coordinates(ring)[:-1]) for ring in rings)


def _arrow_path(svg: SvgFrame, line: Polyline) -> str:
    """Return the path of small chevrons along a lane."""
    found = ""
    for s in np.arange(ARROWS_M / 2, line.length, ARROWS_M):
        yaw = line.yaw_at(float(s))
        ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
        tip = np.array(line.at(float(s)))
        found += svg.line_path(tip + np.array((left - 1.4 * ahead, 0 * ahead, -left - 1.4 * ahead)) * ARROW_M)
    return found


def _draw_asphalt(d: str, width: float) -> Markup:
    return tag("path", d=d, class_="asphalt", stroke_width=f"{width * CM:.0f}")


def _draw_tracks(svg: SvgFrame, entry: ReportEntry) -> Markup:
    raw, track, known = entry.raw, entry.reconstructed, entry.best_track
    return join_markup(
        (
            render_path(svg.dots_path(raw.xy), id=f"raw-{entry.number}") if raw else None,
            render_path(svg.line_path(track.xy, track.valid), id=f"way-{entry.number}")
            if track and track.valid.any()
            else None,
            _draw_box(svg, known, entry.number) if known and known.valid.any() else None,
        )
    )


def _draw_box(svg: SvgFrame, track: RecordedTrack, number: int) -> Markup:
    """Return the box where the object is last seen."""
    last = int(track.valid_frames[-1])
    length, width = _size_at(track, last)
    yaw = float(np.nan_to_num(track.yaw[last]))
    pose = (float(track.x[last]), float(track.y[last]), yaw)
    return render_path(svg.vehicle_path(pose, length, width), id=f"box-{number}")


def _size_at(track: RecordedTrack, frame: int) -> tuple[float, float]:
    usual = DEFAULT_SIZE_M[track.category]
    length, width = float(track.length[frame]), float(track.width[frame])
    return (length if length > 0 else usual[0], width if width > 0 else usual[1])


def draw_overview(map_frame: MapFrame, entries: Sequence[ReportEntry]) -> Markup:
    """Return the overview: static objects below, failing actors on top, CAVs marked."""
    moving = sorted(
        (entry for entry in reversed(entries) if entry.verdict_class != "rest"), key=lambda entry: entry.is_cav
    )
    still = [entry for entry in entries if entry.verdict_class == "rest"]
    size = 0.013 * max(map_frame.view.size) * CM
    return render_picture(
        f"Map of the log with {len(moving)} tracks and {len(still)} static objects",
        map_frame.svg_frame.view_box_attribute(map_frame.view),
        render_use("roads", "roads"),
        _render_layer("rest", (_draw_reference(entry, boxes=True) for entry in still)),
        _render_layer("raw", (render_use(f"raw-{entry.number}", "raw") for entry in moving if entry.raw)),
        _render_layer("way", (_draw_reference(entry, boxes=False) for entry in moving)),
        _render_layer("boxes", (_draw_reference(entry, boxes=True) for entry in moving)),
        _render_layer("names", _draw_numbers(map_frame, moving, size)),
        render_scale_bar(map_frame.svg_frame, map_frame.view),
        class_="map",
    )


def _render_layer(name: str, content: Iterable[MarkupValue]) -> Markup:
    return tag("g", *content, class_=f"layer-{name}")


def _draw_reference(entry: ReportEntry, boxes: bool) -> Markup | None:
    """Return the path or the box, which links to the actor's entry. Only the mouse uses this link; the table has links
    for all."""
    there = entry.best_track is not None and entry.best_track.valid.any() if boxes else entry.reconstructed is not None
    if not there:
        return None
    cav = " cav" if entry.is_cav else ""
    shape = render_use(
        f"{'box' if boxes else 'way'}-{entry.number}", f"{'box' if boxes else 'way'} {entry.verdict_class}{cav}"
    )
    verdict = "fails" if entry.actor.failed else "passes"
    words = tag("title", f"No. {entry.number}: {entry.actor.category}, {verdict} ({entry.actor.id})")
    return tag("a", words, shape, href=f"#actor-{entry.number}", tabindex="-1")


def _draw_numbers(map_frame: MapFrame, entries: Sequence[ReportEntry], size: float) -> Iterable[Markup]:
    """Yield the numbers of CAVs and failing actors beside their boxes, `size` [cm] high, none over another one."""
    named = [
        entry
        for entry in reversed(entries)  # CAVs first
        if (entry.is_cav or entry.verdict_class == "fail") and entry.best_track and entry.best_track.valid.any()
    ]
    names = [f"CAV {entry.number}" if entry.is_cav else f"{entry.number}" for entry in named]
    spots = [_find_last_spot(map_frame.svg_frame, entry) for entry in named]
    requests = [
        LabelRequest(x, -y, NAME_ASPECT * size * len(name), size, 0.7 * size)
        for name, (x, y) in zip(names, spots, strict=True)
    ]
    for entry, name, box in zip(named, names, place_labels(requests, _list_boxes(spots)), strict=True):
        look = f"name {'cav' if entry.is_cav else 'fail'}"
        place = {"x": f"{box.x:.0f}", "y": f"{0.35 * size - box.y:.0f}"}
        yield tag("text", name, **place, font_size=f"{size:.0f}", class_=look, text_anchor="middle")


def _find_last_spot(svg: SvgFrame, entry: ReportEntry) -> tuple[float, float]:
    """Return where an object is last seen [cm]."""
    track = entry.best_track
    assert track is not None
    last = int(track.valid_frames[-1])
    x, y = svg.to_cm(np.array([[track.x[last], track.y[last]]]))[0].tolist()
    return float(x), float(y)


def _list_boxes(spots: Iterable[tuple[float, float]]) -> list[LabelBox]:
    """Return the middles of the objects, which labels keep free; y is up, as for labels."""
    return [LabelBox(x, -y, CM, CM) for x, y in spots]


def draw_actor_map(map_frame: MapFrame, entry: ReportEntry) -> Markup | None:
    """Return the raw and reconstructed path of one actor with the roads around it."""
    if not len(entry.xy):
        return None
    view = fit_view(entry.xy, 4.0, LEAST_THING_M, 0.7)
    n = entry.number
    return render_picture(
        f"Path of No. {n}: dots are the log, the line is reconstructed",
        map_frame.svg_frame.view_box_attribute(view),
        render_use("roads", "roads"),
        render_use(f"box-{n}", f"box {entry.verdict_class}{' cav' if entry.is_cav else ''}")
        if entry.best_track
        else None,
        render_use(f"way-{n}", f"way {entry.verdict_class}") if entry.reconstructed else None,
        render_use(f"raw-{n}", "raw") if entry.raw else None,
        render_scale_bar(map_frame.svg_frame, view, words=0.035),
        class_="map small",
    )


def draw_thumbnail(map_frame: MapFrame, roads: RoadMap, entries: Sequence[ReportEntry]) -> Markup:
    """Return a simplified, self-contained overview."""
    lanes = (lane.centre.xy for lane in roads.driving if map_frame.view.is_near(lane.centre.xy))
    ways: dict[str, str] = {}
    for entry in entries:
        if entry.reconstructed is not None and entry.actor.moving:
            look = "cav" if entry.is_cav and entry.verdict_class != "fail" else entry.verdict_class
            xy = entry.reconstructed.xy[entry.reconstructed.valid]
            ways[look] = ways.get(look, "") + map_frame.svg_frame.line_path(_simplify(xy))
    return render_picture(
        f"Map with {sum(entry.actor.moving for entry in entries)} tracks",
        map_frame.svg_frame.view_box_attribute(map_frame.view),
        _draw_asphalt("".join(map_frame.svg_frame.line_path(_simplify(xy)) for xy in lanes), THUMBNAIL_LANE_M),
        *(render_path(ways[look], class_=f"way {look}") for look in ("walk", "pass", "cav", "fail") if look in ways),
        class_="thumbnail",
    )


def _simplify(xy: Float) -> Float:
    """Return a line (N, 2) with fewer points; a single point stays."""
    if len(xy) < 2:
        return xy
    return shapely.get_coordinates(shapely.simplify(shapely.LineString(xy), THUMBNAIL_STEP_M))


def draw_far_points(svg: SvgFrame, xy: Float) -> Markup:
    """Return marks where the network deviates from its source."""
    return render_path(svg.dots_path(xy), class_="far")
