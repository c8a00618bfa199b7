"""Maps of the report. Roads and tracks are drawn once and referenced by the overview and by every actor's map."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from markupsafe import Markup
from shapely.geometry.polygon import orient

from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from mdrive_sumo.report.label_placement import LabelBox, LabelRequest, place_labels
from mdrive_sumo.report.map_view import MapView, fit_view
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.drawing.map_geometry import build_map_geometry
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.report_entry import ReportEntry
from real2sim.fidelity_report.svg import (
    CM,
    SvgFrame,
    SvgValue,
    join_markup,
    render_path,
    render_picture,
    render_scale_bar,
    render_use,
    tag,
)
from real2sim.fidelity_targets import CENTRE_LINES_MEAN_M
from real2sim.hd_map import HdMap, LaneKind
from real2sim.logged_drive import LoggedCav, LoggedInfraction
from real2sim.network import NetworkReport
from real2sim.network.lane_directions import reverse_lane
from real2sim.network.map_measurements import SPACING_M, measure_line_distances
from real2sim.polylines import sample_polylines
from real2sim.recording import DEFAULT_SIZE_M, RecordedTrack

OVERVIEW_MARGIN_M = 12.0
"""[m] Ground shown around the outermost positions: three lanes, so that a road user at the edge has its road."""
ROADS_BEYOND_M = 60.0
"""[m] Roads are drawn this far beyond the overview, for the small maps at its edge."""
MIN_OVERVIEW_M, MIN_ACTOR_MAP_M = 50.0, 24.0
"""[m] Least extent of the overview and of an actor's map: a parked car is shown with its surroundings."""
ACTOR_MAP_MARGIN_M = 4.0
"""[m] Ground shown around the path of an actor: about one lane."""
INFRACTION_MAP_M = 36.0
"""[m] Width of the picture of an infraction: two junction arms and the lanes beside."""
INFRACTION_NEAR_M = 10.0
"""[m] Road users this far outside the picture of an infraction are drawn too: their boxes may reach into it."""
ARROW_SPACING_M, ARROW_HALF_WIDTH_M = 10.0, 0.45
"""[m] Distance between the arrows on a lane, and half their width."""
NAME_ASPECT = 0.66
"""Mean width of a letter relative to its height."""
THUMBNAIL_LANE_M, THUMBNAIL_STEP_M = 3.5, 0.4
"""[m] Width of every lane in a thumbnail, and how far simplified lines may lie off: below a pixel of it."""
SCALE_WORDS_SHARE = 0.035
"""Font size of the scale of a small map, as a share of its size: twice that of the overview, which is shown larger."""


class CaptionedPicture(NamedTuple):
    """A picture with the words below it."""

    picture: Markup
    caption: str


@dataclass(frozen=True, slots=True)
class MapFrame:
    """The overview's view and its position on the page."""

    svg_frame: SvgFrame
    view: MapView


def fit_map_frame(entries: Sequence[ReportEntry]) -> MapFrame:
    """Return a view of everything that the log shows."""
    places = [entry.xy for entry in entries]
    view = fit_view(np.concatenate(places) if places else np.zeros((0, 2)), OVERVIEW_MARGIN_M, MIN_OVERVIEW_M, 0.5)
    return MapFrame(SvgFrame(view.left, view.high), view)


def draw_definitions(map_frame: MapFrame, roads: RoadMap, entries: Sequence[ReportEntry]) -> Markup:
    """Return roads and tracks as invisible definitions for all pictures of the page."""
    drawn = join_markup((_draw_tracks(map_frame.svg_frame, entry) for entry in entries), "\n")
    return tag("svg", tag("defs", _draw_roads(map_frame, roads), "\n", drawn), class_="definitions", aria_hidden="true")


def _draw_roads(map_frame: MapFrame, roads: RoadMap) -> Markup:
    """Return the roads with the geometry of all pictures of the network, and an arrow along every lane."""
    svg, view = map_frame.svg_frame, map_frame.view
    area = shapely.box(view.left, view.low, view.right, view.high).buffer(ROADS_BEYOND_M, join_style="mitre")
    geometry = build_map_geometry(roads, area)
    lanes = (lane for lane in roads.driving if not lane.junction and view.is_near(lane.centre.xy, ROADS_BEYOND_M))
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
    path = ""
    for s in np.arange(ARROW_SPACING_M / 2, line.length, ARROW_SPACING_M):
        yaw = line.yaw_at(float(s))
        ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
        tip = np.array(line.at(float(s)))
        path += svg.line_path(tip + np.array((left - 1.4 * ahead, 0 * ahead, -left - 1.4 * ahead)) * ARROW_HALF_WIDTH_M)
    return path


def _draw_tracks(svg: SvgFrame, entry: ReportEntry) -> Markup:
    raw, track, best = entry.raw, entry.reconstructed, entry.best_track
    return join_markup(
        (
            render_path(svg.dots_path(raw.xy), id=f"raw-{entry.number}") if raw else None,
            render_path(svg.line_path(track.xy, track.valid), id=f"way-{entry.number}")
            if track and track.valid.any()
            else None,
            _draw_box(svg, best, entry.number) if best and best.valid.any() else None,
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


def _render_layer(name: str, content: Iterable[SvgValue]) -> Markup:
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
    kept_free = [LabelBox(x, -y, CM, CM) for x, y in spots]  # the objects themselves; y is up, as for labels
    for entry, name, box in zip(named, names, place_labels(requests, kept_free), strict=True):
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


def draw_actor_map(map_frame: MapFrame, entry: ReportEntry) -> Markup | None:
    """Return the raw and reconstructed path of one actor with the roads around it."""
    if not len(entry.xy):
        return None
    view = fit_view(entry.xy, ACTOR_MAP_MARGIN_M, MIN_ACTOR_MAP_M, 0.7)
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
        render_scale_bar(map_frame.svg_frame, view, words=SCALE_WORDS_SHARE),
        class_="map small",
    )


def draw_thumbnail(map_frame: MapFrame, roads: RoadMap, entries: Sequence[ReportEntry]) -> Markup:
    """Return a simplified, self-contained overview."""
    lanes = (lane.centre.xy for lane in roads.driving if map_frame.view.is_near(lane.centre.xy))
    asphalt = "".join(map_frame.svg_frame.line_path(_simplify(xy)) for xy in lanes)
    ways: dict[str, str] = {}
    for entry in entries:
        if entry.reconstructed is not None and entry.actor.moving:
            look = "cav" if entry.is_cav and entry.verdict_class != "fail" else entry.verdict_class
            xy = entry.reconstructed.xy[entry.reconstructed.valid]
            ways[look] = ways.get(look, "") + map_frame.svg_frame.line_path(_simplify(xy))
    return render_picture(
        f"Map with {sum(entry.actor.moving for entry in entries)} tracks",
        map_frame.svg_frame.view_box_attribute(map_frame.view),
        tag("path", d=asphalt, class_="asphalt", stroke_width=f"{THUMBNAIL_LANE_M * CM:.0f}"),
        *(render_path(ways[look], class_=f"way {look}") for look in ("walk", "pass", "cav", "fail") if look in ways),
        class_="thumbnail",
    )


def _simplify(xy: Float) -> Float:
    """Return a line (N, 2) with fewer points; a single point stays."""
    if len(xy) < 2:
        return xy
    return shapely.get_coordinates(shapely.simplify(shapely.LineString(xy), THUMBNAIL_STEP_M))


@dataclass(frozen=True)
class CentreLineDeviation:
    """Points every metre on the source's centre lines, and their distances from the network."""

    lines: tuple[Float, ...]
    xy: Float
    distance: Float


def compute_deviation(findings: ConversionFindings) -> CentreLineDeviation:
    """Return the deviation as in `network.measure`, with the positions."""
    lines = _select_lanes(findings.recording.map, findings.network)
    if not lines:
        return CentreLineDeviation((), np.zeros((0, 2)), np.zeros(0))
    distance = measure_line_distances(lines, [lane.centre for lane in findings.roads.driving])
    return CentreLineDeviation(tuple(line.xy for line in lines), sample_polylines(lines, SPACING_M).xy, distance)


def _select_lanes(map: HdMap, network: NetworkReport) -> list[Polyline]:
    """Return the driving lanes that the network contains, in their direction of travel."""
    inverted = set(network.directions.inverted)
    lanes = [
        lane
        for id_, lane in map.lanes.items()
        if lane.kind is LaneKind.DRIVING and (id_ not in network.drop_reason_by_lane or id_ in network.lost_in_part)
    ]
    return [build_polyline((reverse_lane(lane) if lane.id in inverted else lane).centre) for lane in lanes]


def draw_deviation(deviation: CentreLineDeviation, map_frame: MapFrame) -> CaptionedPicture:
    """Return the source's centre lines with marks where the network is further off than the mean may be."""
    svg = map_frame.svg_frame
    near = [line for line in deviation.lines if map_frame.view.is_near(line, ROADS_BEYOND_M)]
    far = deviation.xy[deviation.distance > CENTRE_LINES_MEAN_M]
    label = (
        f"Centre lines of the source over the network: {len(far)} of {len(deviation.xy)} m deviate by more than"
        f" {CENTRE_LINES_MEAN_M:g} m"
    )
    picture = render_picture(
        label,
        svg.view_box_attribute(map_frame.view),
        render_use("roads", "roads"),
        render_path("".join(svg.line_path(line) for line in near), class_="source"),
        render_path(svg.dots_path(far), class_="far"),
        render_scale_bar(svg, map_frame.view),
        class_="map",
    )
    return CaptionedPicture(picture, f"{label} (marked).")


def draw_infractions(
    findings: ConversionFindings, entries: Sequence[ReportEntry], map_frame: MapFrame
) -> tuple[CaptionedPicture, ...]:
    """Return a picture of every infraction of the logged drives, with a sentence."""
    return tuple(
        CaptionedPicture(_draw_infraction(findings, entries, map_frame, cav, infraction), _describe(cav, infraction))
        for cav in (findings.logged_drive.cavs if findings.logged_drive else ())
        for infraction in cav.infractions
    )


def _describe(cav: LoggedCav, infraction: LoggedInfraction) -> str:
    other = f" ({infraction.other})" if infraction.other else ""
    place = f"at ({infraction.x:.1f}, {infraction.y:.1f}) m"
    verdict = "not confirmed"
    if infraction.is_confirmed:
        verdict = f"confirmed by {infraction.confirmed_by}: {infraction.reason}"
    span = f"{infraction.from_s:g} s" + (f" to {infraction.to_s:g} s" if infraction.to_s > infraction.from_s else "")
    return f"CAV {cav.id}, {span}, {place}: {infraction.kind}{other}, factor {infraction.factor:.3g}; {verdict}."


def _draw_infraction(
    findings: ConversionFindings,
    entries: Sequence[ReportEntry],
    map_frame: MapFrame,
    cav: LoggedCav,
    infraction: LoggedInfraction,
) -> Markup:
    """Return the roads around the place, the CAV's track, and the boxes of all actors at that time."""
    svg = map_frame.svg_frame
    view = fit_view(np.array([[infraction.x, infraction.y]]), 0.0, INFRACTION_MAP_M, 0.7)
    frame = round((infraction.from_s + infraction.to_s) / 2 / findings.recording.dt_s)
    boxes: list[Markup] = []
    cav_path: Markup | None = None
    for entry in entries:
        track = entry.reconstructed
        if track is None:
            continue
        is_cav = findings.names.get(entry.actor.id, entry.actor.id) == cav.id
        if is_cav:
            cav_path = render_use(f"way-{entry.number}", f"way {entry.verdict_class}")
        row = min(frame, len(track.valid) - 1)
        if not track.valid[row] or not view.is_near(track.xy[row][None], INFRACTION_NEAR_M):
            continue
        pose = (float(track.x[row]), float(track.y[row]), float(np.nan_to_num(track.yaw[row])))
        size = float(np.nanmedian(track.length)), float(np.nanmedian(track.width))
        look = f"box {entry.verdict_class}{' cav' if is_cav else ''}"
        boxes.append(render_path(svg.vehicle_path(pose, *size), class_=look))
    return render_picture(
        f"{infraction.kind} of CAV {cav.id} at {infraction.from_s:g} s",
        svg.view_box_attribute(view),
        render_use("roads", "roads"),
        cav_path,
        *boxes,
        render_scale_bar(svg, view, words=SCALE_WORDS_SHARE),
        class_="map small",
    )
