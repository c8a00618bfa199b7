"""The report of one conversion: a page that shows how faithful a scenario is to its log, and where it deviates."""

from collections.abc import Sequence
from pathlib import Path

from mdrive_sumo.core.output_files import write_text
from real2sim.clean.cleaning_report import ChangeReason
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.actor_section import ActorSection, gather_actors, render_actor_cards, render_actor_table
from real2sim.fidelity_report.formatting import CLEANING_ACTIONS, describe_figure, format_figure, format_frames
from real2sim.fidelity_report.html import (
    Markup,
    join_markup,
    link_entry,
    render_collapsible_list,
    render_list,
    render_page,
    render_table,
    tag,
)
from real2sim.fidelity_report.logged_drive_section import render_logged_drive_section
from real2sim.fidelity_report.map_figures import MapFrame, draw_definitions, draw_overview, fit_map_frame
from real2sim.fidelity_report.network_section import render_network_section
from real2sim.fidelity_report.report_entry import ReportEntry, build_entries, number_by_id
from real2sim.fidelity_report.target_tiles import find_missed_targets, render_tiles
from real2sim.fidelity_report.traffic_section import render_traffic_section
from real2sim.fidelity_targets import count_sumo_driven
from real2sim.quality import CHECKS

PAGE = "conversion.html"
LAYERS = (("raw", "log (dots)"), ("way", "reconstructed (lines)"), ("rest", "static objects"), ("names", "numbers"))


def write_report(folder: Path, findings: ConversionFindings) -> Path:
    """Write `conversion.html` into the scenario's folder. The same findings give the same bytes."""
    path = folder / PAGE
    write_text(path, render_report(findings))
    return path


def render_report(findings: ConversionFindings) -> str:
    """Return the page as text."""
    entries = build_entries(findings)
    map_frame = fit_map_frame(entries)
    actors = gather_actors(findings, entries, map_frame)
    return render_page(
        f"{findings.id} · conversion",
        draw_definitions(map_frame, findings.roads, entries),
        tag(
            "header", _render_heading(findings), _render_verdict(find_missed_targets(findings)), render_tiles(findings)
        ),
        tag(
            "main",
            _render_section("map", "Log and reconstruction", _render_map(map_frame, entries)),
            _render_section("actors", "Actors", _render_actors_intro(findings), render_actor_table(actors)),
            _render_section("pictures", "Actor by actor", _render_picture_legend(), render_actor_cards(actors)),
            _render_section("traffic", "Reactive traffic against the log", render_traffic_section(findings, entries)),
            _render_section(
                "drive", "Logged drive of the CAVs", render_logged_drive_section(findings, entries, map_frame)
            ),
            _render_section(
                "network", "Network against the map of the log", render_network_section(findings, map_frame)
            ),
            _render_section("cleaning", "What cleaning changed", _render_cleaning(findings, actors)),
            _render_section("scene", "Between actors", _render_scene(findings, entries)),
            _render_section("reading", "How to read this", _render_explanation()),
        ),
    )


def _render_section(id_: str, title: str, *content: Markup | None) -> Markup:
    return tag("section", tag("h2", title, id=id_), "\n", *content, aria_labelledby=id_)


def _render_heading(findings: ConversionFindings) -> Markup:
    recording, quality = findings.recording, findings.quality
    seconds = quality.frames * recording.dt_s
    facts = [f"read as {recording.source}", f"{format_frames(quality.frames)}, {seconds:.1f} s"]
    if findings.window_s:
        facts.append(f"window {findings.window_s[0]:g} s to {findings.window_s[1]:g} s of the log")
    facts += [f"{len(quality.actors)} actors", f"network {findings.roads.name}", f"traffic {findings.mode}"]
    back = tag("a", "all scenarios", href=f"../{PAGE}")
    links = ("map", "actors", "pictures", "traffic", "drive", "network", "cleaning", "reading")
    menu = tag("nav", back, *(tag("a", name, href=f"#{name}") for name in links), aria_label="Page")
    return join_markup((menu, tag("h1", findings.id), tag("p", " · ".join(facts), class_="facts-line")))


def _render_verdict(misses: Sequence[str]) -> Markup:
    """Return one sentence for each missed target."""
    if not misses:
        return tag("p", tag("strong", "Faithful."), " Every measured figure meets its target.", class_="verdict met")
    words = f"Misses {len(misses)} target{'' if len(misses) == 1 else 's'}."
    return tag("div", tag("strong", words), render_list(misses), class_="verdict missed")


def _render_map(map_frame: MapFrame, entries: Sequence[ReportEntry]) -> Markup:
    switches = [
        tag("label", tag("input", type="checkbox", id=f"show-{name}", checked=""), f" {words}")
        for name, words in LAYERS
    ]
    switches.append(tag("label", tag("input", type="checkbox", id="enlarge"), " enlarged"))
    legend = (
        ("pass", "vehicle, passes"),
        ("fail", "fails a check"),
        ("walk", "pedestrian or cyclist, passes"),
        ("rest", "static"),
        ("cav", "CAV"),
    )
    keys = render_list((tag("i", class_=f"key {look}") + words for look, words in legend), "legend")
    return join_markup(
        (
            tag("div", keys, tag("fieldset", tag("legend", "Show"), *switches), class_="controls"),
            tag(
                "figure",
                tag(
                    "div",
                    draw_overview(map_frame, entries),
                    class_="wide",
                    tabindex="0",
                    role="region",
                    aria_label="Map",
                ),
                tag(
                    "figcaption",
                    "Boxes show the last position of each actor and point ahead. A click on one leads to its card.",
                ),
            ),
        )
    )


def _render_actors_intro(findings: ConversionFindings) -> Markup:
    quality = findings.quality
    sumo_driven = count_sumo_driven(quality, findings.roles, findings.mode)
    words = (
        f"{quality.moving_passed} of {quality.moving_vehicles} moving vehicles, {quality.walkers_passed} of"
        f" {quality.walkers} pedestrians and cyclists and {quality.static_passed} of {quality.static_things} static"
        " objects pass every check. Failing actors come first."
        f" SUMO drives {sumo_driven} of the moving vehicles ({findings.mode}); the"
        " others are CAVs, or scripted on their path of the log."
    )
    return tag("p", words)


def _render_picture_legend() -> Markup:
    return tag(
        "p",
        "Dots and thin grey lines are the log, thick lines are reconstructed; dashed lines are limits. The cards of"
        " failing actors are open; the others open with a click.",
    )


def _render_cleaning(findings: ConversionFindings, actors: ActorSection) -> Markup:
    report = findings.cleaned.report
    counts = report.count_by_reason()
    touched = {reason: sum(change.frames for change in report.list_changes(reason)) for reason in ChangeReason}
    rows = [
        (reason.value, CLEANING_ACTIONS.get(reason, ""), str(counts[reason.value]), str(touched[reason]))
        for reason in ChangeReason
        if reason.value in counts
    ]
    notes = [*findings.recording.notes, *findings.notes]
    numbers = number_by_id(tuple(actors.entries))
    gone = [change for change in report.changes if change.track not in numbers]
    return join_markup(
        (
            render_table(
                ("reason", "what was found and done", "changes", "frames"), rows, "Cleaning by reason", text_columns=2
            )
            if rows
            else tag("p", "Nothing.", class_="none"),
            render_collapsible_list(
                "Changes to tracks that are not in the scenario",
                [f"{c.track}: {c.reason.value}, {c.detail}" for c in gone],
            ),
            render_collapsible_list("Removed tracks", [f"{id_}: {why}" for id_, why in findings.quality.lost.items()]),
            render_collapsible_list("Notes on reading and fitting", notes),
        )
    )


def _render_scene(findings: ConversionFindings, entries: tuple[ReportEntry, ...]) -> Markup:
    quality, numbers = findings.quality, number_by_id(entries)

    def pair(a: str, b: str, more: str = "") -> Markup:
        return join_markup((link_entry(a, numbers), " and ", link_entry(b, numbers), more))

    least = format_figure(quality.least_distance, "m")
    return join_markup(
        (
            tag(
                "p",
                f"Least distance between two actors: {least}. Boxes of logs are annotated by hand; a few centimetres"
                " of overlap are tolerated.",
            ),
            render_collapsible_list(
                "Overlaps at the first frame of an actor", [pair(a, b) for a, b in quality.spawn_overlaps]
            ),
            render_collapsible_list(
                "Later overlaps", [pair(a, b, f", {format_frames(n)}") for a, b, n in quality.collisions]
            ),
            render_collapsible_list("Duplicates", [pair(a, b) for a, b in quality.duplicates]),
        )
    )


def _render_explanation() -> Markup:
    rows = [
        (describe_figure(check.figure)[0], f"{check.limit:g} {describe_figure(check.figure)[1]}", check.source)
        for check in CHECKS
    ]
    words = tag(
        "p",
        "Dots are positions of the log after cleaning, lines what the scenario starts from. A vehicle passes if it"
        " meets every limit below; checks of lanes and turning do not apply to pedestrians. Every distance is between"
        " box centres in the same frame. Accelerations and jerks are those of cubics fitted to 0.7 s of positions."
        " Lane checks apply where the map has lanes. See docs/real2sim.md for details.",
    )
    return join_markup(
        (words, render_table(("check of every actor", "limit", "source"), rows, "Checks", text_columns=3))
    )
