"""The row of all scenarios, and the table of a suite."""

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from real2sim.fidelity_targets import FidelityTarget
from real2sim.pipeline.quality_file import QualityFile
from real2sim.pipeline.suite_summary import FidelityRow, format_summary, summarize_suite

SUMMED = (
    *("moving_passed", "moving_vehicles", "by_sumo", "wrong_way_frames", "teleports", "collisions", "contacts"),
    *("order_kept", "order_pairs", "spawn_overlaps", "duplicates", "confirmed_infractions", "logged_infractions"),
)
WORST = ("error_median", "error_p95", "jerk_p95", "worst_at_5s")


def quality(
    id_: str, counts: int = 1, figure: float | None = 0.5, missed: str = "", stalled: int | None = 0
) -> QualityFile:
    """The figures of one scenario: all counts alike, all measures alike."""
    targets = [FidelityTarget(name="error p95", value=0.5, limit=1.0, unit="m")]
    targets += [FidelityTarget(name=missed, value=2.0, limit=1.0, unit="m")] if missed else []
    some = ("",) * counts
    fidelity = SimpleNamespace(
        moving_passed=counts, moving_vehicles=counts, wrong_way_frames=counts, teleports=counts, error_median=figure,
        error_p95=figure, jerk_p95=figure or 0.0, spawn_overlaps=some, duplicates=some, collisions=some,
    )  # fmt: skip
    errors = [SimpleNamespace(after_s=after_s, worst=(figure or 0.0) + after_s) for after_s in (2.0, 5.0)]
    closeness = SimpleNamespace(
        median_at_5s=figure, errors=errors if figure is not None else [], contacts=some, order_kept=counts,
        order_pairs=counts,
    )  # fmt: skip
    vehicles = None if stalled is None else [SimpleNamespace(id=f"{k // 2}") for k in range(2 * stalled)]
    drive = SimpleNamespace(unconfirmed=some, confirmed_count=counts)
    return SimpleNamespace(  # pyright: ignore[reportReturnType]
        scenario=id_, fidelity=fidelity, closeness=closeness, by_sumo=counts, stalled=vehicles, logged_drive=drive,
        targets=targets, passed=not missed,
    )  # fmt: skip


figures = st.none() | st.floats(0.0, 9.0)


@given(st.lists(st.tuples(st.integers(0, 5), figures, st.none() | st.integers(0, 3)), min_size=1, max_size=5))
def test_counts_add_up_and_errors_are_those_of_the_worst_scenario(
    scenarios: list[tuple[int, float | None, int | None]],
) -> None:
    found = summarize_suite([quality(f"s{k}", *one[:2], stalled=one[2]) for k, one in enumerate(scenarios)])
    rows, together = found.scenarios, found.all
    assert together.scenario == f"all {len(scenarios)}"
    for name in SUMMED:
        assert getattr(together, name) == sum(getattr(row, name) for row in rows)
    for name in WORST:
        values = [value for row in rows if (value := getattr(row, name)) is not None]
        assert getattr(together, name) == max(values, default=None)
    known = sorted(figure for _, figure, _ in scenarios if figure is not None)
    assert together.median_at_5s is None if not known else known[0] <= (together.median_at_5s or 0.0) <= known[-1]
    looked = [stalled for *_, stalled in scenarios if stalled is not None]
    assert together.stalled == (sum(looked) if looked else None)


def test_one_row_has_the_figures_of_its_scenario() -> None:
    row = summarize_suite([quality("s", 3, 0.25, stalled=2)]).scenarios[0]
    assert (row.scenario, row.by_sumo, row.duplicates, row.contacts, row.logged_infractions) == ("s", 3, 3, 3, 3)
    assert (row.error_p95, row.median_at_5s, row.worst_at_5s) == (0.25, 0.25, 5.25)  # not that after 2 s
    assert row.stalled == 2  # vehicles: each of them stalls twice
    assert row.passed


def test_a_suite_passes_if_all_do_and_a_missed_target_is_listed_under_its_scenario() -> None:
    assert summarize_suite([quality("a"), quality("b")]).all.passed
    found = summarize_suite([quality("a"), quality("b", missed="jerk p95"), quality("c", missed="jerk p95")])
    assert not found.all.passed
    sentence = "jerk p95: 2 m, at most 1 m wanted"
    assert found.misses == {"jerk p95": {"b": sentence, "c": sentence}}
    lines = format_summary(found).splitlines()
    assert lines[-2:] == [f"b: {sentence}", f"c: {sentence}"]


@pytest.mark.parametrize(("figure", "stalled"), [(0.5, 0), (None, None)])
def test_the_table_has_a_column_for_every_figure_and_a_dash_where_nothing_was_measured(
    figure: float | None, stalled: int | None
) -> None:
    found = summarize_suite([quality("a_long_name_of_a_scenario", 1, figure, stalled=stalled), quality("b", 1000)])
    head, *rows = format_summary(found).splitlines()[:4]
    columns = head.split("  ")
    names = [name.strip() for name in columns if name.strip()]
    assert len(names) == len(FidelityRow.model_fields) - 3  # x of y, by SUMO of y, kept of pairs, found + confirmed
    for row in rows:
        assert len([cell for cell in row.split("  ") if cell.strip()]) == len(names)
    first = rows[0].split()
    assert first.count("-") == (0 if figure is not None else 5)
    assert [row.split()[-1] for row in rows] == ["passed"] * 3
    assert format_summary(found).endswith("Every figure meets its target.")
