"""Published tables and the values behind them: what pages show is what files give, and unusable files."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from testing.paths import ROOT
from testing.study_samples import make_open_run, make_recording, make_run, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_markdown
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.scoring import Results, load_unchecked_results, save_results
from mdrive_sumo.scoring.results import BusyRatioSummary, SentRate
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.study.gain import AGENTS, GainRow, summarise_gain
from mdrive_sumo.study.gain_files import build_gain_table
from mdrive_sumo.study.paper.paper_study import select_results
from mdrive_sumo.study.twin_scenarios import TwinFactor
from mdrive_sumo.study.twins import ORIGINAL
from mdrive_sumo.v2x.comm_settings import PRESETS, describe_comm
from tools import write_published_tables
from tools.aim_tables import MeasuredDrivers, SuiteFigure, list_hard_figures, list_log_figures
from tools.paper_values import TABLES as PAPER_TABLES
from tools.published_values import WHOLE, name_open_file, read_opened, read_values, write_values
from tools.write_published_tables import MARK, TABLES, WITHOUT_FILE, fill_page, find_pages, load_values

PLACES = 12
SLOW = "open-closed.md", "detectors-driving.md"
"""Pages whose tables take seconds: rank correlations of many resamples, certificates of a whole suite."""


def drive(agent: str, ds: float, seed: int = 0, **facts: object) -> Results:
    """A run of two scenarios on each of twelve places."""
    scenarios = [
        make_scenario(f"{place}_{i}", ds + place / 4 + seed, seed).model_copy(update={"place": f"place{place}"})
        for place in range(PLACES)
        for i in range(2)
    ]
    return make_run(*scenarios, **({"agent": agent, "sensing": "realistic"} | facts))


def list_gain_runs() -> list[Results]:
    return [
        drive(agent, 60.0 + 5 * i + 2 * j, seed, sensing=str(sensing))
        for j, sensing in enumerate(SensingProfile)
        for i, agent in enumerate(AGENTS)
        for seed in (0, 1)
    ]


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.slow] * (page.name in SLOW)) for page in find_pages(ROOT)],
    ids=str,
)
def test_pages_show_what_their_files_give(page: Path) -> None:
    text = (ROOT / page).read_text("utf-8")
    assert fill_page(text, ROOT, str(page)) == text, "python -m tools.write_published_tables"


def test_each_file_of_values_is_shown() -> None:
    shown = {name for page in find_pages(ROOT) for _, name, *_ in MARK.findall((ROOT / page).read_text("utf-8"))}
    files = {path.stem.removesuffix("-open") for path in (ROOT / write_published_tables.VALUES).iterdir()}
    assert files <= shown


def test_scores_and_settings_come_back_with_six_decimals(tmp_path: Path) -> None:
    runs = [drive("idm", 61.123456), drive("single", 70.0, 1)]
    write_values(tmp_path / "a.parquet", {WHOLE: runs})
    found = read_values(tmp_path / "a.parquet")[WHOLE]
    assert [one.run for one in found] == [one.run for one in runs]
    assert [one.overall for one in found] == [one.overall for one in runs]
    names = ("id", "seed", "place", "bucket", "status", "ds", "sr", "rc", "ip", "time_ratio", "efficient_sr")
    assert [[getattr(one, name) for name in names] for run in found for one in run.scenarios] == [
        [getattr(one, name) for name in names] for run in runs for one in run.scenarios
    ]
    assert pq.read_table(tmp_path / "a.parquet").column("agent").to_pylist()[0] == "idm", "any reader shows it"


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project with one page, whose tables are not written yet."""
    (tmp_path / "docs").mkdir()
    marks = "\n".join(
        f"<!-- values:gain:{name}:begin -->\nold\n<!-- values:gain:{name}:end -->" for name in ("gain", "gain-scores")
    )
    (tmp_path / "docs" / "page.md").write_text(f"# Page\n\n{marks}\n\nText.\n")
    monkeypatch.setattr(write_published_tables, "ROOT", tmp_path)
    monkeypatch.setattr(write_published_tables, "load_results", load_unchecked_results)  # made without CAVs
    return tmp_path


def write(*words: object) -> str:
    ended = CliRunner().invoke(write_published_tables.main, [*map(str, words)])
    return f"{ended.exit_code} {ended.output}"


def test_the_command_collects_runs_and_writes_the_tables_that_the_study_writes(root: Path) -> None:
    runs = list_gain_runs()
    for i, results in enumerate(runs):
        (root / "runs" / str(i)).mkdir(parents=True)
        save_results(results, root / "runs" / str(i) / "results.json")
    assert write("--values", "gain", root / "runs").startswith(f"0 changed: {Path('docs', 'page.md')}")
    text = (root / "docs" / "page.md").read_text()
    rows = [GainRow(SensingProfile(runs[i].run.conditions["sensing"]), runs[i].run.agent, tuple(runs[i : i + 2]))
            for i in range(0, len(runs), 2)]  # fmt: skip
    assert format_markdown(build_gain_table(summarise_gain(rows))) in text
    assert "DS: Of 4 differences" in text and "SR: Of 4 differences" in text
    assert text.endswith("Text.\n") and "old" not in text
    assert write() == "0 ", "written once, nothing changes"


@pytest.mark.parametrize("name", [name for name in TABLES if not name.startswith(("gain", "message-gain"))])
def test_each_kind_of_table_is_made_of_values(name: str, tmp_path: Path) -> None:
    runs = [
        drive(agent, ds + int(season), suite=f"mdrive@{season}", suite_checksum=f"sha256:{season}")
        for season in (("1", "2") if name.startswith("seasons") else ("1",))
        for agent, ds in (("idm", 60.0), ("single", 70.0))
    ]
    write_values(tmp_path / "x.parquet", {WHOLE: runs})
    table = TABLES[name](read_values(tmp_path / "x.parquet")[WHOLE])
    assert "single" in "".join(table) and table == TABLES[name](runs)


def test_values_that_are_written_again_have_the_same_bytes(tmp_path: Path) -> None:
    runs = [drive("sharing", 61.123456, labels=("sharing",)), drive("omniscient", 99.0, labels=("privileged",))]
    write_values(tmp_path / "a.parquet", {"a": runs, "b": runs[:1]})
    write_values(tmp_path / "b.parquet", read_values(tmp_path / "a.parquet"))
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


def find_figures(figures: Iterable[SuiteFigure]) -> dict[str, tuple[float | None, bool | None]]:
    return {one.name: (one.interval and one.interval.mean, one.is_met) for one in figures}


def test_aims_of_the_hard_tier_are_met_or_not() -> None:
    fast = AgentSpec("single", {"speed_share": 1.5}).config_hash()
    runs = [
        drive("constant-speed", 20.0),
        drive("memory", 24.0),
        drive("single", 30.0),
        drive("single", 41.0, agent_config=fast),
        drive("single", 31.0, sensing="perfect"),
        drive("sharing", 60.0),
        drive("sharing+negotiation", 71.0),
    ]
    found = find_figures(list_hard_figures(MeasuredDrivers(runs)))
    middle = 11 / 8  # of twelve places, each a quarter better than the one before
    assert found["single"] == (30 + middle, True) and found["single, sensing perfect"] == (31 + middle, True)
    assert found["single, 1.5 x the limit"] == (41 + middle, False)
    assert found["sharing+negotiation, the best rule"] == (71 + middle, True)
    assert found["memory - constant-speed"] == (4.0, False)
    assert found["sharing - single"] == (30.0, True)
    assert found["omniscient"] == found["omniscient - sharing+negotiation"] == (None, None)


def test_aims_of_v2xpnp_compare_the_same_agent_over_worse_channels() -> None:
    clean = describe_comm(PRESETS["realistic"])
    late = {**clean, "latency_ticks": 6.0}
    off = {**clean, "pose_error_m": 0.6, "pose_error_deg": 0.6}
    runs = [drive("single", 70.0, comm=clean), drive("sharing", 80.0, comm=clean)]
    runs += [drive("constant-speed", 61.0, comm=clean)]
    runs += [drive("sharing", 80.0, comm=late), drive("sharing", 75.0, comm=off)]
    found = find_figures(list_log_figures(MeasuredDrivers(runs)))
    assert found["constant-speed"][1] is False and found["single"][1] is False
    assert found["sharing - single"] == (10.0, True)
    assert found["sharing, 6 ticks of latency"] == (0.0, False)
    assert found["sharing, pose error of 0.6 m and 0.6°"] == (-5.0, True)
    assert found["sharing+negotiation, 6 ticks of latency"] == (None, None)


def test_the_table_of_channels_tells_what_was_sent_and_how_busy_they_were(tmp_path: Path) -> None:
    its_g5 = PRESETS["its-g5"]
    assert its_g5.radio is not None
    busy = replace(its_g5, radio=replace(its_g5.radio, connected_background=0.5))
    loads = {
        "sent_rates": {"cam": SentRate(messages_s=4.0, bytes_s=200.0), "cpm": SentRate(messages_s=2.0, bytes_s=1000.0)},
        "busy_ratio": BusyRatioSummary(mean=0.125, greatest=0.5),
    }
    runs = [drive("sharing", 80.0), drive("sharing", 75.0, comm=describe_comm(its_g5)),
            drive("sharing", 70.0, comm=describe_comm(busy))]  # fmt: skip
    loaded = [one.model_copy(update=loads) for one in runs[2].scenarios]
    runs[2] = runs[2].model_copy(update={"scenarios": tuple(loaded)})
    write_values(tmp_path / "x.parquet", {WHOLE: runs})
    described, table, note, _ = TABLES["channels"](read_values(tmp_path / "x.parquet")[WHOLE])
    assert described == TABLES["channels"](runs)[0] and note.startswith("Condition `base` is ideal. kB/s")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    assert [(row[1], row[7], *row[-2:]) for row in rows] == [
        ("base", "", "", ""),
        ("its-g5", "-5.0 [-5.0, -5.0]", "", ""),
        ("its-g5, 50% connected", "-10.0 [-10.0, -10.0]", "1.20", "0.125"),
    ]


def test_the_table_of_attacks_is_that_of_the_study(tmp_path: Path) -> None:
    """Attacks come in the order of the study, drives without a defence after those with one."""
    runs = [
        drive("sharing", 60.0, attack="shift"),
        drive("sharing", 40.0, attack="phantom", agent_config="sha256:0"),
        drive("sharing", 55.0, attack="phantom"),
        drive("sharing", 65.0, agent_config="sha256:0"),
        drive("sharing", 64.0),
        drive("single", 50.0),
    ]
    write_values(tmp_path / "x.parquet", {WHOLE: runs})
    _, table, counted = TABLES["attacks"](read_values(tmp_path / "x.parquet")[WHOLE])
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    assert [(*row[:3], *(cell.partition(" ")[0] for cell in row[4:])) for row in rows] == [
        ("single", "-", "none", "", "", ""),
        ("sharing", "on", "none", "+14.0", "", "-1.0"),
        ("sharing", "on", "phantom", "+5.0", "-9.0", "+15.0"),
        ("sharing", "on", "shift", "+10.0", "-4.0", ""),
        ("sharing", "off", "none", "+15.0", "", ""),
        ("sharing", "off", "phantom", "-10.0", "-25.0", ""),
    ]
    assert counted.startswith("DS: Of 5 differences")


def test_the_table_of_twins_is_that_of_the_study(root: Path) -> None:
    """Its runs lie in folders that are named after what the twins change; the drive that finds occluders is none."""
    for part, agent, ds in ((ORIGINAL, "single", 40.0), (TwinFactor.OCCLUDER, "single", 52.5), ("reference", "x", 1.0)):
        folder = root / "runs" / agent / part
        folder.mkdir(parents=True)
        save_results(drive(agent, ds), folder / "results.json")
    values = load_values([root / "runs"])
    assert {part: [one.run.agent for one in found] for part, found in values.items()} == {
        "occluder, original": ["single"],
        "occluder": ["single"],
    }
    write_values(root / "docs/results/values/twins.parquet", values)
    page = "<!-- values:twins:twins:begin -->\n<!-- values:twins:twins:end -->"
    assert "| single | occluder | 24 | 41.4 | 53.9 | +12.5 [+12.5, +12.5] |" in fill_page(page, root, "page.md")
    with pytest.raises(InputError, match="table gain: expected values of single runs, found values of study twins"):
        fill_page(page.replace(":twins:twins", ":twins:gain"), root, "page.md")
    write_values(root / "docs/results/values/twins.parquet", {WHOLE: list_gain_runs()})
    with pytest.raises(InputError, match="table twins: expected values of study twins, found values of single"):
        fill_page(page, root, "page.md")


def save_paper_runs(folder: Path) -> None:
    """Agents on twelve places, some in both loops, one with latency on fewer, and the drives of the reference."""
    learned = ("tcp", 50.0), ("codriving:alone", 55.0), ("codriving", 62.0), ("perception-swap:none", 40.0)
    closed = ("idm", 60.0), ("single", 70.0), ("sharing", 80.0), *learned
    runs = [*((f"closed/{agent}", agent, ds) for agent, ds in closed), ("reference/omniscient", "omniscient", 99.0)]
    names = [one.id for one in drive("idm", 0.0).scenarios]
    for part, agent, ds in (*runs, ("channel/sharing/latency_6_ticks", "sharing", 75.0)):
        (folder / part).mkdir(parents=True)
        driven = drive(agent, ds)
        if agent in ("sharing", "codriving"):
            talked = [one.model_copy(update={"exchanged": {"cam": 1}}) for one in driven.scenarios]
            driven = make_run(*talked, agent=agent, sensing="realistic")
        if part.startswith("channel"):  # perturbations are driven in fewer scenarios
            driven = select_results(driven, names[:22])
        save_results(driven, folder / part / "results.json")
    for agent, ade in (
        ("idm", 3.0), ("single", 2.0), ("sharing", 1.0), ("omniscient", 0.5), ("perception-swap:none", 4.0),
    ):  # fmt: skip
        (folder / "open" / agent).mkdir(parents=True)
        shown = make_open_run(agent, [make_recording(name, ade, ((0.5, 3, 4),)) for name in names])
        (folder / "open" / agent / "open_loop.json").write_text(shown.model_dump_json())


def test_tables_of_the_papers_study_have_values_of_both_loops(root: Path) -> None:
    save_paper_runs(root / "runs")
    page = "\n".join(f"<!-- values:p:{name}:begin -->\n<!-- values:p:{name}:end -->" for name in PAPER_TABLES)
    (root / "docs" / "page.md").write_text(page)
    assert write("--values", "p", root / "runs").startswith("0 changed")
    text = (root / "docs" / "page.md").read_text()
    assert "| ADE [m] | DS | 4 | +1.00 [+1.00, +1.00] | +1.00 [+1.00, +1.00] |" in text
    assert "| sharing | 81.25 | 76.25 | -5.00 [-5.00, -5.00] |" in text
    for line in (
        "| all | 24 | 63.38 | 56.38 | +7.00 [+7.00, +7.00] | gain | - |",
        "| *of it messages: codriving minus codriving:alone* |  |  |  |  |  |  |",
        "| *features on request: codriving - codriving:alone* |  |  |  |  |  |",
    ):
        assert line in text
    assert text.count("scenarios: 24, places: 12") == 6 and text.count("scenarios: 22, places:") == 1, "of latency"
    assert "No agent of this study exchanges messages." in text, "no run with pose error"
    path = root / write_published_tables.VALUES / "p.parquet"
    files = [path.read_bytes(), name_open_file(path).read_bytes()]
    write_values(path, read_values(path), read_opened(path))
    assert files == [path.read_bytes(), name_open_file(path).read_bytes()]
    name_open_file(path).unlink()
    assert "table open-closed: expected every agent in both loops, found no runs of open loop" in write()


def test_a_table_of_several_seasons_or_with_missing_runs_is_refused() -> None:
    runs = [drive("single", 70.0, suite=f"mdrive@{season}", suite_checksum=f"sha256:{season}") for season in (1, 2)]
    for name in TABLES:
        if not name.startswith("seasons"):
            with pytest.raises(InputError, match=r"expected runs of one suite( and season)?, found mdrive@1"):
                TABLES[name](runs)
    with pytest.raises(InputError, match=r"expected sharing, sensing realistic, with seeds \[0, 1\], found \[1\]"):
        TABLES["gain"]([one for one in list_gain_runs() if one.run.agent != "sharing" or one.run.seed])
    other = drive("single", 60.0, comm=describe_comm(PRESETS["its-g5"]))
    with pytest.raises(InputError, match="table attacks: expected an agent without a defence, found none"):
        TABLES["attacks"]([drive("sharing", 70.0)])
    bare = drive("sharing", 70.0, agent_config="sha256:0", attack="hide")
    with pytest.raises(InputError, match="expected an honest run of sharing without defence, found none"):
        TABLES["attacks"]([drive("single", 70.0), drive("sharing", 70.0), bare])
    with pytest.raises(InputError, match="table channels: expected a run of single over channel ideal, found none"):
        TABLES["channels"]([drive("sharing", 70.0), other])


def test_a_table_that_is_older_than_its_file_says_so(root: Path) -> None:
    page = "<!-- values:gain:gain:begin -->\nThe values of these runs were not kept.\n<!-- values:gain:gain:end -->"
    assert fill_page(page, root, "page.md") == page
    assert fill_page(new := page.replace(WITHOUT_FILE[0], WITHOUT_FILE[1]), root, "page.md") == new
    write_values(root / "docs/results/values/gain.parquet", {WHOLE: list_gain_runs()})
    text = fill_page(page, root, "page.md")
    assert "not kept" not in text and "Shown after correction, for DS and SR apart" in text
    assert "total in InterDrive (DS +10.0)" in text and "seeds: 0, 1." in text


def test_files_that_cannot_be_used_are_named(root: Path) -> None:
    path = root / "docs/results/values/gain.parquet"
    assert write().startswith("2 ") and "gain.parquet" in write()
    write_values(path, {WHOLE: list_gain_runs()})
    table = pq.read_table(path)
    metadata = dict(table.schema.metadata)
    pq.write_table(table.replace_schema_metadata(metadata | {b"format": b"mdrive-sumo/published-values/9"}), path)
    with pytest.raises(InputError, match=r"gain.parquet: format: expected .*/2, found .*/9; `python -m tools"):
        read_values(path)
    pq.write_table(table.drop_columns(["place"]).replace_schema_metadata(metadata), path)
    with pytest.raises(InputError, match="expected the columns run, part, agent"):
        read_values(path)
    pq.write_table(table.replace_schema_metadata(metadata | {b"runs": b"[{}]"}), path)
    with pytest.raises(InputError, match="expected runs and scores of this version"):
        read_values(path)
    path.write_bytes(b"PAR1 no")
    assert write().startswith("2 ") and "cannot be read" in write()


def test_runs_of_which_no_table_can_be_made_change_no_file(root: Path) -> None:
    for season in (1, 2):
        (root / "runs" / str(season)).mkdir(parents=True)
        results = drive("single", 70.0, suite=f"mdrive@{season}")
        save_results(results, root / "runs" / str(season) / "results.json")
    assert "expected runs of one suite and season" in write("--values", "gain", root / "runs")
    assert not (root / write_published_tables.VALUES).exists() and "old" in (root / "docs" / "page.md").read_text()


def test_bad_arguments_are_one_sentence(root: Path) -> None:
    assert "found one without the other" in write("--values", "gain")
    assert "found no results.json below" in write("--values", "gain", root / "docs")
    page = "<!-- values:gain:oops:begin -->\n<!-- values:gain:oops:end -->"
    with pytest.raises(InputError, match=r"page.md: table: expected one of gain, .*, found oops"):
        fill_page(page, root, "page.md")
