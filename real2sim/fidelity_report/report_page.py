"""The report of one conversion: a page that shows how faithful a scenario is to its log, and where it deviates."""

from collections.abc import Sequence
from pathlib import Path

from real2sim.clean.cleaning_report import ChangeReason
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.actor_section import ActorSection, gather_actors, render_actor_cards, render_actor_table
from real2sim.fidelity_report.formatting import CLEANED, describe_figure, format_figure, format_frames
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
from real2sim.fidelity_report.map_figures import MapFrame, draw_definitions, draw_overview, fit_map_frame
from real2sim.fidelity_report.network_section import render_network_section
from real2sim.fidelity_report.report_entry import ReportEntry, build_entries, number_by_id
from real2sim.fidelity_report.target_tiles import find_missed_targets, render_tiles
from real2sim.fidelity_report.traffic_section import render_traffic_section
from real2sim.fidelity_targets import count_sumo_driven
from real2sim.quality import CHECKS

PAGE = "conversion.html"
LAYERS = (("raw", "log (dots)"), ("way", "reconstructed (lines)"), ("rest", "what stands"), ("names", "numbers"))


def write_report(folder: Path, findings: ConversionFindings) -> Path:
    """Write `conversion.html` into the scenario's folder. The same findings give the same bytes."""
    path = folder / PAGE
    path.write_text(render_report(findings), encoding="utf-8")
    return path


def render_report(findings: ConversionFindings) -> str:
    """Return the page as text."""
    things = build_entries(findings)
    plan = fit_map_frame(things)
    actors = gather_actors(findings, things, plan)
    return render_page(
        f"{findings.id} · conversion",
        draw_definitions(plan, findings.roads, things),
        tag("header", _heading(findings), _verdict(find_missed_targets(findings)), render_tiles(findings)),
        tag(
            "main",
            _section("map", "Log and reconstruction", _map_part(plan, things)),
            _section("actors", "Actors", _actors_intro(findings), render_actor_table(actors)),
            _section("pictures", "Actor by actor", _filters(), render_actor_cards(actors)),
            _section("traffic", "Reactive traffic against the log", render_traffic_section(findings, things)),
            _section("network", "Network against the map of the log", render_network_section(findings, plan)),
            _section("cleaning", "What cleaning changed", _cleaning_part(findings, actors)),
            _section("scene", "Between actors", _scene_part(findings, things)),
            _section("reading", "How to read this", _reading_part()),
        ),
    )


def _section(id_: str, title: str, *content: Markup | None) -> Markup:
    return tag("section", tag("h2", title, id=id_), "\n", *content, aria_labelledby=id_)


def _heading(findings: ConversionFindings) -> Markup:
    recording, quality = findings.recording, findings.quality
    seconds = quality.frames * recording.dt_s
    facts = [f"read as {recording.source}", f"{format_frames(quality.frames)}, {seconds:.1f} s"]
    if findings.window_s:
        facts.append(f"window {findings.window_s[0]:g} s to {findings.window_s[1]:g} s of the log")
    facts += [f"{len(quality.actors)} actors", f"network {findings.roads.name}", f"traffic {findings.mode}"]
    back = tag("a", "all scenarios", href=f"../{PAGE}")
    links = ("map", "actors", "pictures", "traffic", "network", "cleaning", "reading")
    menu = tag("nav", back, *(tag("a", name, href=f"#{name}") for name in links), aria_label="Page")
    return join_markup((menu, tag("h1", findings.id), tag("p", " · ".join(facts), class_="facts-line")))


def _verdict(misses: Sequence[str]) -> Markup:
    """Return one sentence for each missed target."""
    if not misses:
        return tag("p", tag("strong", "Faithful."), " Every measured figure meets its target.", class_="verdict met")
    words = f"Misses {len(misses)} target{'' if len(misses) == 1 else 's'}."
    return tag("div", tag("strong", words), render_list(misses), class_="verdict missed")


def _map_part(plan: MapFrame, things: Sequence[ReportEntry]) -> Markup:
    switches = [
        tag("label", tag("input", type="checkbox", id=f"show-{name}", checked=""), f" {words}")
        for name, words in LAYERS
    ]
    switches.append(tag("label", tag("input", type="checkbox", id="enlarge"), " enlarged"))
    legend = (
        ("pass", "vehicle, passes"),
        ("fail", "fails a check"),
        ("walk", "on foot or cycle, passes"),
        ("rest", "stands still"),
        ("cav", "CAV"),
    )
    keys = render_list((tag("i", class_=f"key {look}") + words for look, words in legend), "legend")
    return join_markup(
        (
            tag("div", keys, tag("fieldset", tag("legend", "Show"), *switches), class_="controls"),
            tag(
                "figure",
                tag("div", draw_overview(plan, things), class_="wide", tabindex="0", role="region", aria_label="Map"),
                tag(
                    "figcaption",
                    "Boxes stand where things are last seen, their points ahead. A click on one leads to its pictures.",
                ),
            ),
        )
    )


def _actors_intro(findings: ConversionFindings) -> Markup:
    quality = findings.quality
    sumo_driven = count_sumo_driven(quality, findings.roles, findings.mode)
    words = (
        f"{quality.moving_passed} of {quality.moving_vehicles} moving vehicles, {quality.walkers_passed} of"
        f" {quality.walkers} walkers and cyclists and {quality.static_passed} of {quality.static_things} things that"
        " stand pass every check. Failing ones come first."
        f" SUMO drives {sumo_driven} of the moving vehicles ({findings.mode}); the"
        " others are CAVs, or scripted on their path of the log."
    )
    return tag("p", words)


def _filters() -> Markup:
    return tag(
        "p",
        "Dots and thin grey lines are the log, thick lines are reconstructed; dashed lines are limits. Pictures of what"
        " fails are open; the others open with a click.",
    )


def _cleaning_part(findings: ConversionFindings, actors: ActorSection) -> Markup:
    report = findings.cleaned.report
    counts = report.count_by_reason()
    touched = {reason: sum(change.frames for change in report.list_changes(reason)) for reason in ChangeReason}
    rows = [
        (reason.value, CLEANED.get(reason, ""), str(counts[reason.value]), str(touched[reason]))
        for reason in ChangeReason
        if reason.value in counts
    ]
    notes = [*findings.recording.notes, *findings.notes]
    numbers = number_by_id(tuple(actors.things))
    gone = [change for change in report.changes if change.track not in numbers]
    return join_markup(
        (
            render_table(
                ("reason", "what was found and done", "changes", "frames"), rows, "Cleaning by reason", text_columns=2
            )
            if rows
            else tag("p", "Nothing.", class_="none"),
            render_collapsible_list(
                "Changes to what is not in the scenario", [f"{c.track}: {c.reason.value}, {c.detail}" for c in gone]
            ),
            render_collapsible_list(
                "Left out altogether", [f"{id_}: {why}" for id_, why in findings.quality.lost.items()]
            ),
            render_collapsible_list("Notes of reading and fitting", notes),
        )
    )


def _scene_part(findings: ConversionFindings, things: tuple[ReportEntry, ...]) -> Markup:
    quality, numbers = findings.quality, number_by_id(things)

    def pair(a: str, b: str, more: str = "") -> Markup:
        return join_markup((link_entry(a, numbers), " and ", link_entry(b, numbers), more))

    least = format_figure(quality.least_distance, "m")
    return join_markup(
        (
            tag(
                "p",
                f"Nearest to each other: {least}. Boxes of logs are annotated by hand; a few centimetres of"
                " overlap are forgiven.",
            ),
            render_collapsible_list("Overlap when first seen", [pair(a, b) for a, b in quality.spawn_overlaps]),
            render_collapsible_list(
                "Overlap later", [pair(a, b, f", {format_frames(n)}") for a, b, n in quality.collisions]
            ),
            render_collapsible_list("Twice the same thing", [pair(a, b) for a, b in quality.duplicates]),
        )
    )


def _reading_part() -> Markup:
    rows = [
        (describe_figure(check.figure)[0], f"{check.limit:g} {describe_figure(check.figure)[1]}", check.source)
        for check in CHECKS
    ]
    words = tag(
        "p",
        "Dots are positions of the log after cleaning, lines what the scenario starts from. A vehicle passes if it"
        " meets every limit below; people on foot are not asked about lanes and turning. Every distance is between"
        " box centres at the same frame. Accelerations and jerks are those of cubics fitted to 0.7 s of positions."
        " The lanes are judged where the map has any. docs/real2sim.md tells more.",
    )
    return join_markup(
        (words, render_table(("check of every actor", "limit", "where it comes from"), rows, "Checks", text_columns=3))
    )
