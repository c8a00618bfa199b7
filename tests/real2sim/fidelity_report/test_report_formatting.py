"""Words, figures, charts and colours of the report page, without findings of a log."""

import re
from collections.abc import Mapping

import numpy as np
import pytest
from testing.html_page import Page
from testing.paths import ROOT

from real2sim.clean.cleaning_report import ChangeReason
from real2sim.fidelity_report.charts import ChartSeries, LineChart, draw_chart
from real2sim.fidelity_report.formatting import CLEANING_ACTIONS, FIGURES, describe_failures, describe_figure
from real2sim.fidelity_report.index_page import render_index
from real2sim.quality import CHECKS
from real2sim.quality.actor_quality import ActorQuality


def test_every_check_and_every_reason_has_words() -> None:
    assert {check.figure for check in CHECKS} <= set(FIGURES)
    assert set(CLEANING_ACTIONS) == set(ChangeReason)
    assert set(FIGURES) <= set(ActorQuality.model_fields)


def test_a_figure_just_over_its_limit_does_not_read_as_if_it_were_met() -> None:
    limit = next(check.limit for check in CHECKS if check.figure == "error_p95")
    actor = ActorQuality(
        id="a", category="car", moving=True, frames=9, gaps=0, error_p95=limit + 0.0004, failed=("error_p95",)
    )
    assert f"{limit + 0.0004:.4f} m (at most {limit:g} m)" in describe_failures(actor)[0]


def test_a_chart_cuts_off_what_is_too_high_and_breaks_at_gaps() -> None:
    y = np.array([0.0, 1.0, np.nan, 50.0, 1.0])
    svg = draw_chart(LineChart("words", "title", [ChartSeries("line", np.arange(5.0), y)], (0.0, 4.0), 2.0, (1.5, 9.0)))
    (line,) = [part for part in svg.split("<path ") if 'class="line"' in part]
    assert line.count("M") == 2
    assert svg.count('class="limit"') == 1
    (limit,) = [part for part in svg.split("<path ") if 'class="limit"' in part]
    assert limit.count("M") == 1  # the limit beyond the top is not drawn


def test_an_index_of_nothing_is_a_page() -> None:
    assert "0 of 0 scenarios" in Page(render_index("none", [])).text


def colours(css: str) -> Mapping[str, tuple[float, ...]]:
    found = re.findall(r"--([\w-]+): #([0-9a-f]{6})", css)
    return {name: tuple(int(value[k : k + 2], 16) / 255 for k in (0, 2, 4)) for name, value in found}


def contrast(first: tuple[float, ...], second: tuple[float, ...]) -> float:
    """WCAG 2.2, 1.4.3."""

    def luminance(colour: tuple[float, ...]) -> float:
        red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour)
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    high, low = sorted((luminance(first), luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_can_be_read_and_lines_be_told_from_the_road(scheme: str) -> None:
    css = (ROOT / "real2sim" / "fidelity_report" / "static" / "report.css").read_text()
    light, dark = css.split("@media (prefers-color-scheme: dark)")
    colour = colours(light if scheme == "light" else dark.split("* {")[0])
    for ground in ("paper", "card", "stripe"):
        assert all(contrast(colour[ink], colour[ground]) >= 4.5 for ink in ("ink", "muted", "cav", "pass", "fail"))
    assert all(contrast(colour[look], colour[f"{look}-tint"]) >= 4.5 for look in ("pass", "fail", "cav"))
    for line in ("pass", "fail", "walk", "cav", "raw", "source"):
        assert contrast(colour[line], colour["road"]) >= 3.0
        assert contrast(colour[line], colour["card"]) >= 3.0


def test_the_document_names_every_check_with_its_limit_and_source() -> None:
    """Both can only be changed together: docs/real2sim.md is what a reader checks the figures against."""
    text = (ROOT / "docs" / "real2sim.md").read_text("utf-8")
    table = text.split("<!-- checks -->")[1].split("<!-- /checks -->")[0]
    assert table.strip().splitlines()[2:] == check_rows()


def check_rows() -> list[str]:
    """Markdown rows of all checks."""
    rows = ((describe_figure(check.figure), check) for check in CHECKS)
    return [
        f"| {words} | {check.limit:g}{f' {unit}' if unit else ''} | {check.source} |"
        for (words, unit, _), check in rows
    ]
