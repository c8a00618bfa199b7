"""Key figures of a conversion with their targets, as tiles at the head of the report."""

from collections.abc import Mapping

from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.formatting import format_figure
from real2sim.fidelity_report.html import Markup, join_markup, tag
from real2sim.fidelity_targets import FidelityTarget, build_reconstruction_targets, build_traffic_targets

STATES = {True: ("met", "met"), False: ("missed", "missed"), None: ("open", "not measured")}
"""CSS class and label of `Target.met`."""
SHARES = ("moving vehicles passing all checks", "order kept at conflicts")
"""Targets that the tiles show as counts."""


def find_missed_targets(findings: ConversionFindings) -> tuple[str, ...]:
    """Return one sentence for each missed target."""
    return findings.misses or tuple(
        target.format_sentence() for target in _all_targets(findings) if target.met is False
    )


def render_tiles(findings: ConversionFindings) -> Markup:
    """Return the figures as tiles; a missed target is labelled in words, too."""
    quality, closeness = findings.quality, findings.closeness
    passed = f"{quality.moving_passed} of {quality.moving_vehicles}"
    kept = f"{closeness.order_kept} of {closeness.order_pairs}" if closeness else ""
    counts = {SHARES[0]: passed, SHARES[1]: kept}
    tiles = [_render_tile(target, _format_value(target, counts)) for target in _all_targets(findings)]
    return tag("ul", join_markup(tiles, "\n"), class_="tiles", aria_label="Key figures")


def _all_targets(findings: ConversionFindings) -> tuple[FidelityTarget, ...]:
    traffic = build_traffic_targets(findings.closeness) if findings.closeness else ()
    return findings.targets or (*build_reconstruction_targets(findings.quality), *traffic)


def _render_tile(target: FidelityTarget, value: str) -> Markup:
    state, word = STATES[target.met]
    limit = (
        f"{100 * target.limit:g} %" if target.unit == "share" else f"{target.limit:g} {_format_unit(target)}".strip()
    )
    asked = f"at {'least' if target.at_least else 'most'} {limit} · "
    return tag("li", tag("strong", value), tag("span", target.name), tag("small", asked, tag("b", word)), class_=state)


def _format_value(target: FidelityTarget, counts: Mapping[str, str]) -> str:
    """Return the figure; shares as counts, because 95 % of 8 is a matter of one."""
    if target.value is not None and target.name in counts:
        return counts[target.name]
    return format_figure(target.value, _format_unit(target), 2 if target.unit else 0)


def _format_unit(target: FidelityTarget) -> str:
    return target.unit.replace("m/s3", "m/s³")
