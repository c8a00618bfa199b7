"""Reports from Python: tables as data frames, files, and the page in a notebook."""

from pathlib import Path

import pytest
from testing.report_samples import CRASH, make_agent_run, save_run

import mdrive_sumo as md

pytestmark = pytest.mark.slow


def test_a_report_is_a_value(tmp_path: Path) -> None:
    first = save_run(tmp_path / "first", make_agent_run("a", {"i01": (100.0,)}))
    second = save_run(tmp_path / "second", make_agent_run("b", {"i01": (CRASH,)}))
    report = md.build_report([md.load_run(first), str(second)], baseline="a")
    frame = report.to_frame()
    assert list(frame["agent"]) == ["a", "b"] and list(frame["interdrive_ds"]) == [100, CRASH]
    assert [cell.value for cell in report.tables["differences"].find_column("agent")] == ["b"]
    assert "Single-agent:" in str(report) and ".save(folder)" in repr(report)
    with pytest.raises(md.InputError, match=r"table: expected one of main, .*did you mean 'buckets'"):
        report.to_frame("bucket")
    page = report._repr_html_()
    assert page.startswith("<iframe srcdoc=") and "<script" not in page and page.count("&lt;svg") == 3
