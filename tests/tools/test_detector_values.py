"""Published precisions of detectors: pages show what `learn evaluate-detectors` wrote, and RQ3 what was driven."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from testing.study_samples import make_run, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.learning.fusion.conditions import CONDITIONS
from mdrive_sumo.learning.fusion.detector_figures import FigureKey
from mdrive_sumo.learning.fusion.detector_tables import DetectorSummary, write_detectors_json, write_detectors_page
from mdrive_sumo.learning.fusion.detectors_file import read_detectors
from mdrive_sumo.scoring import Results
from tools import write_published_tables
from tools.detector_values import list_detector_order
from tools.published_values import WHOLE, write_values
from tools.write_published_tables import DETECTOR_TABLES, fill_page

PRECISIONS = {"none": 0.6, "late": 0.65, "attfuse": 0.7, "cobevt": 0.75}
DATA = {"frames": 100, "drives": 24, "places": [f"p{i}" for i in range(12)], "vehicles": 700}


def make_interval(mean: float) -> ConfidenceInterval:
    return ConfidenceInterval(mean, mean - 0.05, mean + 0.05, 12, 0.001)


def make_summary() -> DetectorSummary:
    names = [one.name for one in CONDITIONS]
    keys = [FigureKey(name, min_iou, "all") for name in names for min_iou in (0.5, 0.7)]
    return DetectorSummary(
        {name: {"data": DATA} for name in PRECISIONS},
        {name: {key: make_interval(mean - key.min_iou + 0.5) for key in keys} for name, mean in PRECISIONS.items()},
        {name: {one: make_interval(mean - 0.6) for one in names} for name, mean in PRECISIONS.items() if mean > 0.6},
        {"attfuse": {"ideal": {"map_bytes": 1234.5, "heard": 0.9, "age_ms": 10.0, "packets_arrived": 0.8}}},
    )


def mark(name: str, table: str, text: str = "") -> str:
    return f"<!-- values:{name}:{table}:begin -->\n{text}<!-- values:{name}:{table}:end -->\n"


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project with one page of all tables, and a `detectors.json` that is not part of it yet."""
    (tmp_path / "docs").mkdir()
    page = "".join(mark("crowds", table, "No runs are published yet.\n") for table in DETECTOR_TABLES)
    (tmp_path / "docs" / "page.md").write_text(page)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "detectors.json").write_text(write_detectors_json(make_summary()))
    monkeypatch.setattr(write_published_tables, "ROOT", tmp_path)
    return tmp_path


def write(*words: object) -> str:
    ended = CliRunner().invoke(write_published_tables.main, [*map(str, words)])
    return f"{ended.exit_code} {ended.output}"


def test_what_was_measured_comes_back_from_its_file(root: Path) -> None:
    path = root / "out" / "detectors.json"
    assert read_detectors(path) == make_summary()
    assert write_detectors_json(read_detectors(path)) == path.read_text()


def test_the_command_writes_the_tables_that_the_measurement_wrote(root: Path) -> None:
    assert write("--values", "crowds", "--dry-run", root / "out").startswith("0 would change")
    assert write("--values", "crowds", root / "out").startswith("0 changed")
    assert (root / "docs/results/values/crowds.json").read_bytes() == (root / "out/detectors.json").read_bytes()
    text = (root / "docs" / "page.md").read_text()
    page = write_detectors_page(make_summary())
    assert all(line in page for line in text.splitlines() if line.startswith("|"))
    for row in (
        "| attfuse | 70.0 [65.0, 75.0] |",
        "| attfuse | +10.0 [+5.0, +15.0] |",
        "| attfuse | ideal | 1234 | 90.0 | 10 | 80.0 |",
        "| cobevt | 55.0 [50.0, 60.0] | 55.0 [50.0, 60.0] | 86.1 | 66.0 | 54.3 |",
    ):
        assert row in text
    assert "Measured on 100 frames of 24 drives at 12 places with 700 true boxes" in text and "No runs" not in text
    assert write() == "0 ", "written once, nothing changes"


def test_files_of_another_kind_are_one_sentence(root: Path) -> None:
    path = root / "out" / "detectors.json"
    page = json.loads(path.read_text())
    for change, says in (
        (
            {"format": "mdrive-sumo/detectors/2"},
            "format: expected 'mdrive-sumo/detectors/1', found 'mdrive-sumo/detectors/2'",
        ),
        ({"about": {}}, "about: expected one detector or more, found none"),
        ({"about": {"none": {}}}, "precisions: expected one of none, found 'late'"),
    ):
        path.write_text(json.dumps(page | change))
        assert says in (said := write("--values", "crowds", path)) and said.startswith("2 "), said
    (root / "out" / "again").mkdir()
    (root / "out" / "again" / "detectors.json").write_text("{}")
    assert "expected one detectors.json, found" in write("--values", "crowds", root / "out")
    assert not (root / "docs" / "results").exists()
    with pytest.raises(InputError, match=r"crowds\.json: cannot be read"):
        fill_page(mark("crowds", "ap-conditions"), root, "page.md")


def drive(detector: str, ds: float, worse: float = 0.0) -> Results:
    """Twelve places of two scenarios, the later ones worse."""
    scenarios = [
        make_scenario(f"{place}_{i}", ds - worse * place).model_copy(update={"place": f"place{place}"})
        for place in range(12)
        for i in range(2)
    ]
    return make_run(*scenarios, agent=f"perception-swap:{detector}")


def test_the_order_in_precision_stands_beside_that_in_drives(root: Path) -> None:
    """DS in the reverse order of precision: the correlation is -1 in every resample."""
    runs = [drive(name, 80.0 - 10 * i) for i, name in enumerate(PRECISIONS)]
    scores, counted, correlations, _ = list_detector_order(runs, make_summary())
    rows = {cells[1]: cells for line in scores.splitlines()[2:] if (cells := [one.strip() for one in line.split("|")])}
    assert rows["cobevt"][2:4] == ["**75.0**", "**55.0**"] and rows["cobevt"][-2] == "-30.0 [-30.0, -30.0]"
    assert rows["none"][6] == "**80.0 [80.0, 80.0]**" and rows["none"][-2] == ""
    assert counted.startswith("Of 3 differences")
    assert "| AP@0.5 clean | DS | -1.00 [-1.00, -1.00] | -1.00 [-1.00, -1.00] |" in correlations
    write_values(root / "docs/results/values/swap.parquet", {WHOLE: runs})
    with pytest.raises(InputError, match=r"detectors\.json: cannot be read"):
        fill_page(mark("swap", "ap-ds"), root, "page.md")
    (root / "docs/results/values/detectors.json").write_bytes((root / "out/detectors.json").read_bytes())
    filled = fill_page(mark("swap", "ap-ds"), root, "page.md")
    assert "scenarios: 24, places: 12" in filled and correlations in filled


def test_an_order_needs_three_detectors_and_no_fusion() -> None:
    with pytest.raises(InputError, match="expected runs of 3 detectors or more, none among them, found late, attfuse"):
        list_detector_order([drive("attfuse", 70.0), drive("late", 60.0), drive("pillars", 50.0)], make_summary())
