"""The recipes of docs/how-to: their code blocks, applied to a scratch copy of the project, do what they say.

One child process imports the scratch copy in place of the project and runs one function per recipe.
"""

import json
import math
import os
import random
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from testing.paths import ROOT, TESTS

pytestmark = pytest.mark.costly_fixture

PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
PACKAGES = ("mdrive_sumo", "real2sim", "server")
LIMIT_S = 120
BLOCK = re.compile(
    r"^(?:New file `([^`]+)`|In `([^`]+)`, (after|before) `([^`]+)`( \([^)]+\))?):\n\n```\w+\n(.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
"""A line that says where, then the code: a new file, or lines to insert."""


class CodeBlock(NamedTuple):
    """One code block of a recipe."""

    new_file: str
    file: str
    side: str
    anchor: str
    """The line that the block is inserted after or before, without its indentation."""
    where: str
    """Which of several such lines, in words."""
    text: str


def read_blocks(page: Path) -> list[CodeBlock]:
    return [CodeBlock(*found) for found in BLOCK.findall(page.read_text("utf-8"))]


def apply_block(folder: Path, block: CodeBlock) -> None:
    """Create the file, or insert the lines beside the anchor; of several such lines, the one indented as the block."""
    if block.new_file:
        assert not (folder / block.new_file).exists()
        (folder / block.new_file).parent.mkdir(exist_ok=True)
        (folder / block.new_file).write_text(block.text, "utf-8")
        return
    path = folder / block.file
    lines = path.read_text("utf-8").splitlines(keepends=True)
    places = [number for number, line in enumerate(lines) if line.strip() == block.anchor]
    assert bool(block.where) is (len(places) > 1), f"{block.file}: {len(places)} lines {block.anchor!r}: say which"
    if len(places) > 1:
        places = [number for number in places if measure_indent(lines[number]) == measure_indent(block.text)]
    (place,) = (number + (block.side == "after") for number in places)
    path.write_text("".join([*lines[:place], block.text, *lines[place:]]), "utf-8")


def measure_indent(text: str) -> int:
    return len(text) - len(text.lstrip(" "))


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packages with every code block applied; compiled modules are copied for speed, the scenarios are links."""
    folder = tmp_path_factory.mktemp("recipes")
    ignored = shutil.ignore_patterns("scenarios")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=ignored)
    (folder / "mdrive_sumo" / "scenarios").symlink_to(ROOT / "mdrive_sumo" / "scenarios")
    for page in PAGES:
        for block in read_blocks(page):
            apply_block(folder, block)
    for project in folder.glob("*/pyproject.toml"):
        install_project(project)
    return folder


def install_project(project: Path) -> None:
    """Write what an installation leaves, beside the package's module: its folder is put on the path."""
    content = tomllib.loads(project.read_text("utf-8"))["project"]
    about = project.parent / f"{content['name'].replace('-', '_')}-{content['version']}.dist-info"
    about.mkdir()
    about.joinpath("METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {content['name']}\nVersion: {content['version']}\n"
    )
    groups = [
        f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in entries.items())
        for group, entries in content["entry-points"].items()
    ]
    about.joinpath("entry_points.txt").write_text("\n".join(groups))


@pytest.fixture(scope="module")
def in_scratch(scratch: Path) -> Generator[Callable[[Callable[[Path], Any]], Any]]:
    """Calls a function of this file in a process that imports the scratch copy."""
    with ProcessPoolExecutor(1, get_context("spawn"), initializer=enter_scratch, initargs=(scratch,)) as pool:
        yield lambda function: pool.submit(function, scratch).result(LIMIT_S)


def enter_scratch(folder: Path) -> None:
    sys.path[:0] = [str(folder), *(str(project.parent) for project in folder.glob("*/pyproject.toml")), str(TESTS)]
    os.environ["PYTHONPATH"] = os.pathsep.join((str(folder), str(ROOT)))
    os.chdir(folder)


def run_command(*arguments: object) -> str:
    """Return the output of a command that must succeed."""
    from click.testing import CliRunner

    from mdrive_sumo.cli import main

    done = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert done.exit_code == 0, (done.output, done.exception)
    return done.output


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_code_block_is_applied_or_a_command(page: Path) -> None:
    fences = re.findall(r"^```(\w+)$", page.read_text("utf-8"), re.MULTILINE)
    assert fences.count("console") == 1
    assert len(read_blocks(page)) == len(fences) - 1


@pytest.mark.slow
def test_the_code_of_the_recipes_passes_the_linter(scratch: Path) -> None:
    blocks = [block for page in PAGES for block in read_blocks(page)]
    files = {block.new_file or block.file for block in blocks}
    sources = sorted(file for file in files if file.endswith(".py"))
    linter = (sys.executable, "-m", "ruff", "check", "--quiet", "--no-cache", "--config", str(ROOT / "pyproject.toml"))
    done = subprocess.run((*linter, *sources), cwd=scratch, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def drive_baseline(folder: Path) -> tuple[dict[str, Any], str]:
    """Return results and report of a run."""
    from testing.local_executor import run_in_process

    run_in_process(pytest.MonkeyPatch())  # for this process, which ends with the module
    run_command(
        "eval",
        "--suite",
        "interdrive@0",
        "--scenario",
        "i02*",
        "--agent",
        "full-throttle",
        "--out",
        folder / "run",
        "--no-record",
    )
    return json.loads((folder / "run" / "results.json").read_text("utf-8")), (folder / "run" / "report.md").read_text()


@pytest.fixture(scope="module")
def run(in_scratch: Callable[..., Any]) -> tuple[dict[str, Any], str]:
    """Results and report of a run with the baseline and both metrics."""
    return in_scratch(drive_baseline)


@pytest.fixture(scope="module")
def results(run: tuple[dict[str, Any], str]) -> dict[str, Any]:
    return run[0]


@pytest.mark.slow
def test_a_baseline_is_one_file_and_a_line_in_the_registry(results: dict[str, Any]) -> None:
    assert results["run"]["agent"] == "full-throttle"
    assert all(ego["rc"] > 0 for ego in iterate_egos(results))


@pytest.mark.slow
def test_a_scalar_metric_is_a_value_per_scenario_and_a_column(run: tuple[dict[str, Any], str]) -> None:
    results, report = run
    assert set(results["run"]["plug_ins"]) == {"metrics episode_length", "metrics haste"}
    assert all(scenario["scalars"]["episode_length"] > 0 for scenario in results["scenarios"])
    assert "length [s]" in report


@pytest.mark.slow
def test_an_infraction_metric_changes_ds(results: dict[str, Any]) -> None:
    for ego in iterate_egos(results):
        factors = {infraction["kind"]: infraction["factor"] for infraction in ego["infractions"]}
        assert factors.pop("haste") == 0.9
        others = 1.0
        for factor in factors.values():
            others *= factor
        assert ego["ds"] == pytest.approx(ego["rc"] * others * 0.9)


def drive_on_ice(folder: Path) -> dict[str, Any]:
    """Return where a setting appears: options, arguments, journal, results, comparison and page of a run."""
    from dataclasses import replace
    from inspect import signature

    from testing.local_executor import run_in_process

    import mdrive_sumo as md
    from mdrive_sumo.report.run_page.provenance import list_provenance
    from mdrive_sumo.runs.journal import read_fingerprint
    from mdrive_sumo.runs.run_config import RunConfig

    run_in_process(pytest.MonkeyPatch())  # for this process, which ends with the module
    out, usual = folder / "ice", folder / "run"
    grip: dict[str, Any] = {"grip": 0.5}  # type checkers do not know it, nor shall they
    run = md.evaluate(
        agent="full-throttle",
        suite="interdrive@0",
        scenario="i02*",
        out=out,
        workers=1,
        record=False,
        progress=False,
        **grip,
    )
    fingerprint, stored = read_fingerprint(out), RunConfig.from_journal(read_fingerprint(out), out)
    with pytest.raises(md.InputError, match=r"another .*grip 1\.0 \(now 0\.5\)"):
        md.evaluate(agent="full-throttle", suite="interdrive@0", scenario="i02*", out=usual, record=False, **grip)
    with pytest.raises(md.InputError, match=r"grip: expected a number from 0.1 to 1 \[share\], found 2"):
        md.evaluate(**{**grip, "grip": 2})
    return {
        "options": [" ".join(run_command(command, "--help").split()) for command in ("eval", "eval-open")],
        "argument": signature(md.evaluate).parameters["grip"].default,
        "identity": (fingerprint["grip"], stored.to_dict()["grip"], replace(stored, out=None).default_folder("s").name),
        "results": json.loads((out / "results.json").read_text("utf-8"))["run"]["grip"],
        "digests": {read_results(place)["scenarios"][0]["digest"] for place in (out, usual)},
        "difference": [(one.name, one.a, one.b) for one in md.compare(usual, out).settings],
        "provenance": dict(list_provenance(run.results[0], fingerprint))["grip"],
        "report": (out / "report.md").read_text("utf-8"),
        "tables": str(md.build_report([usual, out]).to_frame("provenance")["settings"].tolist()),
    }


def read_results(run: Path) -> dict[str, Any]:
    return json.loads((run / "results.json").read_text("utf-8"))


@pytest.mark.slow
def test_a_setting_is_a_field_and_the_place_that_uses_it(
    run: tuple[dict[str, Any], str], in_scratch: Callable[..., Any]
) -> None:
    assert run[0]["run"]["grip"] == 1.0
    found = in_scratch(drive_on_ice)
    help_text = "--grip SHARE Friction of all roads, as a share of that of a dry road. [default: 1.0; 0.1<=x<=1.0]"
    assert all(help_text in options for options in found["options"])
    assert found["argument"] == 1.0
    assert found["identity"] == (0.5, 0.5, "s-full-throttle-seed0-i02_-0.5-grip-norecord")
    assert found["results"] == 0.5
    assert len(found["digests"]) == 2, "the place that uses it"
    assert found["difference"] == [("grip", "1", "0.5")]
    assert found["provenance"] == "0.5" and "- grip: 0.5" in found["report"] and "grip 0.5" in found["tables"]


def iterate_egos(results: dict[str, Any]) -> Iterator[dict[str, Any]]:
    return (ego for scenario in results["scenarios"] for ego in scenario["egos"])


def read_headways(_: Path) -> tuple[float | None, float, float | None]:
    """Return the headway of a CAV, the gap to the CAV that stands before it, and the headway of one without sensors."""
    import mdrive_sumo as md
    from mdrive_sumo.sensing.sensor_kinds import SMALL_MS, find_object_source, price_sensor

    spec = md.SensorSpec("headway")
    assert (price_sensor(spec), find_object_source([spec])) == (SMALL_MS, "'headway'")  # what its row says of it
    sensors = {"2": [md.SensorSpec("headway", range_m=80.0), md.SensorSpec("objects")]}
    with md.Simulation("i11_ins_sl_town", sensors=sensors) as simulation:
        observations = simulation.reset()
    own, ahead = observations["2"].own, observations["2"].objects
    assert ahead is not None
    gap = math.hypot(ahead.x[0] - own.x, ahead.y[0] - own.y) - float(ahead.length[0])
    return observations["2"].headway, gap, observations["0"].headway  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.slow
def test_the_reading_of_a_sensor_arrives_in_the_observation(in_scratch: Callable[..., Any]) -> None:
    headway, gap, undeclared = in_scratch(read_headways)
    assert headway == pytest.approx(gap, abs=0.1)
    assert undeclared is None


def convert_log(folder: Path) -> tuple[str, str, list[str]]:
    """Convert a log of two cars that follow each other on a straight road."""
    poses = {name: [(start + 0.8 * tick, 0.0, 0.0) for tick in range(31)] for name, start in (("a", 20), ("b", 40))}
    lane = [(float(x), 0.0) for x in range(0, 201, 5)]
    (folder / "drive.json").write_text(json.dumps({"dt_s": 0.1, "lanes": {"lane": lane}, "cars": poses}))
    (folder / "broken.json").write_text("{}")
    from real2sim.readers.jsonlog import read_jsonlog  # pyright: ignore[reportMissingImports]
    from testing.local_executor import LocalExecutor

    from mdrive_sumo.core.errors import InputError
    from real2sim.pipeline import batch, conversion_worker

    # for this process, which ends with the module
    batch.ProcessPool, conversion_worker._redirect_stdout = LocalExecutor, lambda: None
    with pytest.raises(InputError, match=r"broken\.json: dt_s: "):
        read_jsonlog(folder / "broken.json")
    offered = run_command("convert", "--help")
    output = run_command("convert", "jsonlog", folder / "drive.json", "--out", folder / "suite", "--workers", 1)
    return offered, output, [path.parent.name for path in (folder / "suite").glob("*/scenario.json")]


@pytest.mark.slow
def test_a_reader_is_offered_and_converts_a_log(in_scratch: Callable[..., Any]) -> None:
    offered, output, scenarios = in_scratch(convert_log)
    assert "jsonlog " in offered
    assert "1 of 1 scenarios meet every target" in output
    assert len(scenarios) == 1


def propose_category(_: Path) -> tuple[str, list[str], list[str], str]:
    from mdrive_sumo.generate.category_requirements import CATEGORIES, Category
    from mdrive_sumo.generate.llm_prompt import build_prompt
    from mdrive_sumo.generate.network_choice import find_networks
    from mdrive_sumo.generate.rules import find_rule_violations
    from mdrive_sumo.generate.template_proposer import propose

    category = Category("jaywalking")
    assert list(CATEGORIES) == list(Category)
    proposals = [propose(category, random.Random(seed)) for seed in range(20)]
    violations = [violation for proposal in proposals for violation in find_rule_violations(proposal)]
    networks = [roads.name for roads in find_networks(proposals[0], CATEGORIES[category].networks)]
    return run_command("generate", "--help"), violations, networks, build_prompt(category, 1)[1]["content"]


@pytest.mark.slow
def test_a_category_is_listed_and_proposed(in_scratch: Callable[..., Any]) -> None:
    offered, violations, networks, prompt = in_scratch(propose_category)
    assert "jaywalking" in offered
    assert (violations, networks) == ([], ["village_street"])
    assert "(Jaywalking), interactivity level dynamic-avoidance" in prompt


def visit_page(folder: Path) -> str:
    from testing.api_app import Server
    from testing.web_page import Visit

    return Visit(Server(folder / "server_data")).get("/status").words


@pytest.mark.slow
def test_a_page_answers(in_scratch: Callable[..., Any]) -> None:
    words = in_scratch(visit_page)
    assert words.startswith("Status mdrive-sumo ")
    assert "Development: open until " in words
