"""Metrics, agents, scenario sources, readers and export formats of another package: used, listed, identified."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.plug_in_package import MODULE, forget_plug_ins, install_package
from testing.short_suite import make_short_suite

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.plug_ins import PlugInKind, list_plug_ins
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.packaged_suites import list_packaged_suites
from mdrive_sumo.scoring.metrics import list_scalar_metrics
from mdrive_sumo.scoring.metrics.registry import list_infraction_metrics

SOURCE = '''
from pathlib import Path
from mdrive_sumo.contract import Control, Reply
from mdrive_sumo.export.export_formats import ExportFormat
from mdrive_sumo.scoring.metrics import InfractionMetric, ScalarMetric

LENGTH = ScalarMetric("length", "length [ticks]", lambda scored: float(scored.episode.ticks), 0)
NEVER = InfractionMetric("never", lambda track: ())
FOLDER = Path(__file__).parent / "suite"
FORMAT = ExportFormat("names of the scenarios", "tiny_plug_ins:write_names")

class Driver:
    """Full throttle."""
    label = "single"
    def __init__(self, config): ...
    def sensors(self): return ()
    def start(self, briefing): ...
    def act(self, seen): return Reply(control=Control(1.0, 0.0, 0.0))

def find_folder(): return FOLDER

def write_names(recordings, folder):
    (folder / "names.txt").write_text(" ".join(one.scenario.id for one in recordings))
'''
ENTRIES = {
    "metrics": {"length": "LENGTH", "never": "NEVER"},
    "agents": {"tiny-driver": "Driver"},
    "scenario_sources": {"tiny-suite": "find_folder"},
    "export_formats": {"names": "FORMAT"},
}


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    make_short_suite(folder / "suite", "i02*", metres=6)
    return folder


@pytest.fixture
def installed(site: Path) -> Iterator[Path]:
    with install_package(site, SOURCE, ENTRIES) as module:
        yield module


def test_they_are_listed_with_package_version_and_checksum(installed: Path) -> None:
    lines = [line.split() for line in call("list", "plug-ins").output.splitlines()[2:]]
    assert [line[:4] for line in lines] == [
        ["metrics", "length", "tiny-plug-ins", "1.2"],
        ["metrics", "never", "tiny-plug-ins", "1.2"],
        ["agents", "tiny-driver", "tiny-plug-ins", "1.2"],
        ["scenario_sources", "tiny-suite", "tiny-plug-ins", "1.2"],
        ["export_formats", "names", "tiny-plug-ins", "1.2"],
    ]
    assert {len(line[4]) for line in lines} == {12}
    assert "tiny-driver" in call("list", "agents").output
    assert "length        informative  plug-in" in call("list", "metrics").output
    assert "names         names of the scenarios" in call("export", "--help").output
    assert list_packaged_suites()["tiny-suite"] == installed.parent / "suite"


@pytest.mark.slow
def test_they_are_part_of_a_run_that_depends_on_them(installed: Path, tmp_path: Path) -> None:
    def fingerprint(**options: object) -> dict[str, str]:
        config = RunConfig(out=tmp_path / "run", scenario="i02*", **{"suite": "interdrive@0", **options})  # pyright: ignore
        return json.loads(str(prepare(config).fingerprint["plug_ins"]))

    assert list(fingerprint()) == ["metrics length", "metrics never"]
    whole = fingerprint(suite="tiny-suite", agent=AgentSpec("tiny-driver"))
    assert list(whole) == ["metrics length", "metrics never", "agents tiny-driver", "scenario_sources tiny-suite"]
    assert all(value.startswith("tiny-plug-ins 1.2 sha256:") for value in whole.values())


@pytest.mark.slow
@pytest.mark.usefixtures("installed", "in_process")
def test_a_run_uses_them_all_and_another_version_is_another_run(installed: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    command = ("eval", "--suite", "tiny-suite", "--agent", "tiny-driver", "--out", run)
    done = call(*command)
    assert done.exit_code == 0, (done.output, done.exception)
    results = json.loads((run / "results.json").read_text())
    assert results["run"]["agent"] == "tiny-driver"
    assert results["run"]["labels"] == ["single", "unsandboxed"]
    assert set(results["run"]["plug_ins"]) >= {"metrics length", "agents tiny-driver"}
    assert all(one["scalars"]["length"] == one["ticks"] for one in results["scenarios"])
    assert "length [ticks]" in (run / "report.md").read_text()
    exported = call("export", run, "--format", "names", "--out", tmp_path / "names")
    assert exported.exit_code == 0, exported.output
    assert (tmp_path / "names" / "names.txt").read_text() == results["scenarios"][0]["id"]
    verified = call("verify", run, "--trust-agent")
    assert verified.exit_code == 0, verified.output
    entries = {kind: dict(names) for kind, names in ENTRIES.items()}
    with install_package(installed.parent, f"{SOURCE}\n# changed\n", entries):
        again = call(*command)
        assert (again.exit_code, "found one with another" in again.output) == (2, True)
        assert "plug_ins: " in again.output
        assert "the agent has changed since this run" in call("verify", run, "--trust-agent").output


def test_without_plug_ins_a_run_is_what_it_was(tmp_path: Path) -> None:
    assert all(not list_plug_ins(kind) for kind in PlugInKind)
    assert "plug_ins" not in prepare(RunConfig(suite="interdrive@0", out=tmp_path / "run", scenario="i02*")).fingerprint
    assert "no plug-ins are installed" in call("list", "plug-ins").output


READER = """
from mdrive_sumo.core.errors import InputError
from real2sim.pipeline.log_source import ReaderPlugIn

def read(log):
    raise InputError(f"{log.path}: tiny reader was here")

TINY = ReaderPlugIn(read, "*.tiny", "Convert tiny logs.")
"""


def test_a_reader_is_a_source_of_convert(tmp_path: Path) -> None:
    (tmp_path / "a.tiny").touch()
    with install_package(tmp_path / "site", READER, {"readers": {"tiny": "TINY"}}):
        assert "tiny" in call("convert", "--help").output
        assert "Convert tiny logs." in call("convert", "tiny", "--help").output
        from real2sim.pipeline.log_source import LogSource, read_log

        with pytest.raises(InputError, match="tiny reader was here"):
            read_log(LogSource("tiny", tmp_path / "a.tiny"))


@pytest.mark.parametrize(
    ("kind", "name", "source", "sentence"),
    [
        ("metrics", "length", "X = 3", "expected a ScalarMetric or InfractionMetric with the name 'length', found 3"),
        ("metrics", "min_ttc", "X = 3", "expected a name of its own, found that of a built-in one"),
        ("metrics", "length", "Y = 3", "metrics plug-in 'length' of tiny-plug-ins 1.2: cannot be imported: "),
        ("metrics", "length", "import no_such_module", "cannot be imported: No module named 'no_such_module'"),
        ("metrics", "length", "def", "cannot be imported: "),
        ("agents", "idm", "X = 3", "agents plug-in 'idm' of tiny-plug-ins 1.2: expected a name of its own"),
        ("scenario_sources", "mine", "X = '/nowhere'", "expected the folder of a suite with suite.json"),
        ("scenario_sources", "mdrive", "X = '/nowhere'", "expected a name of its own"),
        ("export_formats", "mine", "X = 3", "expected an ExportFormat, found 3"),
        ("export_formats", "csv", "X = 3", "expected a name of its own"),
        ("readers", "mine", "X = 3", "expected a ReaderPlugIn, found 3"),
    ],
)
def test_a_plug_in_that_is_none_is_a_sentence(tmp_path: Path, kind: str, name: str, source: str, sentence: str) -> None:
    commands = {
        "metrics": ("eval", "--suite", "interdrive@0", "--scenario", "i02*", "--out", tmp_path / "run"),
        "agents": ("eval", "--suite", "interdrive@0", "--scenario", "i02*", "--out", tmp_path / "run"),
        "scenario_sources": ("list", "suites"),
        "export_formats": ("export", tmp_path, "--format", "csv", "--out", tmp_path / "out"),
        "readers": ("convert", "mine", tmp_path, "--out", tmp_path / "out"),
    }
    with install_package(tmp_path / "site", source, {kind: {name: "X"}}):
        done = call(*commands[kind])
    assert done.exit_code == 2, (done.output, done.exception)
    assert sentence in done.output


@pytest.mark.parametrize("value", ["tiny_plug_ins", "tiny_plug_ins:", "no module"])
def test_an_entry_point_without_an_object_is_a_sentence(tmp_path: Path, value: str) -> None:
    with install_package(tmp_path, "X = 3", {"agents": {"mine": "X"}}, "tiny"):
        (about,) = tmp_path.glob("*.dist-info/entry_points.txt")
        about.write_text(f"[mdrive_sumo.agents]\nmine = {value}\n")
        forget_plug_ins()
        with pytest.raises(InputError, match=f"expected module:object as its entry point, found '{value}'"):
            list_plug_ins(PlugInKind.AGENTS)


def test_a_name_that_two_packages_give_is_a_sentence(tmp_path: Path) -> None:
    with (
        install_package(tmp_path / "a", "X = Y = 3", {"agents": {"mine": "X"}}, "first"),
        install_package(tmp_path / "b", "X = Y = 3", {"agents": {"mine": "Y"}}, "second"),
        pytest.raises(
            InputError, match=r"'mine' of .* expected a name of its own, found that of agents plug-in 'mine'"
        ),
    ):
        list_plug_ins(PlugInKind.AGENTS)


def test_metrics_of_other_packages_come_last(installed: Path) -> None:
    assert installed.stem == MODULE
    assert list_scalar_metrics()[-1].name == "length"
    assert list_infraction_metrics()[-1].name == "never"
