"""Report section on the CAVs' logged drives: the scorer's verdict, and a picture of every infraction."""

import numpy as np

from mdrive_sumo.report.map_view import fit_view
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.formatting import format_figure
from real2sim.fidelity_report.html import Markup, join_markup, render_table, tag
from real2sim.fidelity_report.map_figures import MapFrame
from real2sim.fidelity_report.report_entry import ReportEntry
from real2sim.fidelity_report.svg import render_path, render_picture, render_scale_bar, render_use
from real2sim.logged_drive import LoggedCav, LoggedInfraction

HEAD = ("CAV", "end", "route completion [%]", "infractions", "penalty factor")
PICTURE_M = 36.0
"""[m] Width of a picture: two junction arms and the lanes beside."""


def render_logged_drive_section(
    findings: ConversionFindings, entries: tuple[ReportEntry, ...], map_frame: MapFrame
) -> Markup:
    """Return a table of the CAVs, and a picture with a sentence for every infraction."""
    drive = findings.logged_drive
    if drive is None:
        return tag("p", "Not measured.", class_="none")
    words = (
        "Every CAV repeats its track, everything else is as in the log, and the scorer of live episodes judges it."
        " Infractions are errors of the conversion, or of the driver: a person decides by these pictures and"
        " lists the driver's in the file of --confirmed."
    )
    rows = [
        (cav.id, cav.end, f"{cav.rc:.1f}", str(len(cav.infractions)), format_figure(cav.ip, decimals=3))
        for cav in drive.cavs
    ]
    pictures = [
        tag("figure", _draw_infraction(findings, entries, map_frame, cav, one), tag("figcaption", _describe(cav, one)))
        for cav in drive.cavs
        for one in cav.infractions
    ]
    return join_markup((tag("p", words), render_table(HEAD, rows, "Logged drives", text_columns=2), *pictures))


def _describe(cav: LoggedCav, one: LoggedInfraction) -> str:
    other = f" ({one.other})" if one.other else ""
    place = f"at ({one.x:.1f}, {one.y:.1f}) m"
    verdict = f"confirmed by {one.confirmed_by}: {one.reason}" if one.is_confirmed else "not confirmed"
    when = f"{one.from_s:g} s" + (f" to {one.to_s:g} s" if one.to_s > one.from_s else "")
    return f"CAV {cav.id}, {when}, {place}: {one.kind}{other}, factor {one.factor:.3g}; {verdict}."


def _draw_infraction(
    findings: ConversionFindings,
    entries: tuple[ReportEntry, ...],
    map_frame: MapFrame,
    cav: LoggedCav,
    one: LoggedInfraction,
) -> Markup:
    """Return the roads around the place, the CAV's track, and the boxes of all actors at that time."""
    svg = map_frame.svg_frame
    view = fit_view(np.array([[one.x, one.y]]), 0.0, PICTURE_M, 0.7)
    frame = round((one.from_s + one.to_s) / 2 / findings.recording.dt_s)
    boxes: list[Markup] = []
    way: Markup | None = None
    for entry in entries:
        track = entry.reconstructed
        if track is None:
            continue
        is_cav = findings.names.get(entry.actor.id, entry.actor.id) == cav.id
        if is_cav:
            way = render_use(f"way-{entry.number}", f"way {entry.verdict_class}")
        at = min(frame, len(track.valid) - 1)
        if not track.valid[at] or not view.is_near(track.xy[at][None], 10.0):
            continue
        pose = (float(track.x[at]), float(track.y[at]), float(np.nan_to_num(track.yaw[at])))
        size = float(np.nanmedian(track.length)), float(np.nanmedian(track.width))
        look = f"box {entry.verdict_class}{' cav' if is_cav else ''}"
        boxes.append(render_path(svg.vehicle_path(pose, *size), class_=look))
    return render_picture(
        f"{one.kind} of CAV {cav.id} at {one.from_s:g} s",
        svg.view_box_attribute(view),
        render_use("roads", "roads"),
        way,
        *boxes,
        render_scale_bar(svg, view, words=0.035),
        class_="map small",
    )
