"""The documents tell the truth: every command is described, links lead somewhere, the example runs."""

import json
import re
import runpy
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from testing.paths import ROOT

import mdrive_sumo as md
from mdrive_sumo.cli import COMMANDS, main
from mdrive_sumo.cli.schema import SCHEMAS
from mdrive_sumo.contract import (
    STANDSTILL,
    Briefing,
    Objects,
    Observation,
    OwnState,
    VehicleFacts,
    check_reply,
)
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.report.installation import SYSTEM_LIBRARIES
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.sensing.camera.camera_sensor import read_camera_model
from mdrive_sumo.v2x.comm_settings import PRESETS
from mdrive_sumo.vehicle.control import CONTROLLERS
from tools.write_results import README as README_PAGE
from tools.write_results import RESULTS_PAGE, SPEED_PAGE, build_pages, format_speed, replace_block

PAGES = sorted({*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")})
README = (ROOT / "README.md").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_every_command_is_in_the_page_of_commands() -> None:
    page = (ROOT / "docs" / "cli.md").read_text()
    described = set(re.findall(r"^\| `mdrive-sumo ([a-z][a-z-]*)", page, re.MULTILINE))
    plugged = PROJECT["entry-points"]["mdrive_sumo.commands"]
    assert {*COMMANDS, *plugged} == described


def test_readme_is_a_first_impression_and_not_a_manual() -> None:
    assert len(README.splitlines()) <= 120


def test_readme_uses_names_of_the_python_front_door() -> None:
    used = set(re.findall(r"\bmd\.(\w+)", README))
    assert used
    assert used <= set(md.__all__)


@pytest.mark.parametrize("page", [README_PAGE, RESULTS_PAGE, SPEED_PAGE], ids=str)
def test_tables_of_measured_numbers_are_those_that_the_program_writes(page: Path) -> None:
    """After a new measurement: `python -m tools.write_results RUN...`."""
    assert (ROOT / page).read_text("utf-8") == build_pages((), None, None)[page]


@pytest.mark.parametrize("page", [*PAGES, *sorted(ROOT.glob("docs/tutorials/*.ipynb"))], ids=lambda path: path.name)
def test_commands_that_install_extras_work_today(page: Path) -> None:
    """A release changes `SOURCE`, and this test names the pages to follow."""
    for source, extras in re.findall(r"pip install \'([^\'\[ ]*)\[([\w,]+)\]\'", page.read_text("utf-8")):
        assert f"pip install '{source}[{extras}]'" == format_installation(*extras.split(","))
        assert set(extras.split(",")) <= PROJECT["optional-dependencies"].keys()


def test_every_cited_section_of_the_protocol_is_in_the_docs() -> None:
    """The page restates the protocol: readers of docstrings have no other document."""
    page = (ROOT / "docs" / "protocol.md").read_text("utf-8")
    sections = set(re.findall(r"^#{2,3} (\d+(?:\.\d+)?) ", page, re.MULTILINE)) | set(
        re.findall(r"^\| (K\d+) ", page, re.MULTILINE)
    )
    folders = ("mdrive_sumo", "real2sim", "server", "tools", "tests", "docs")
    files = [path for folder in folders for kind in ("*.py", "*.md") for path in (ROOT / folder).rglob(kind)]
    cited = {
        found[1]
        for path in files
        for found in re.finditer(r"protocol (?:section )?(K?\d+(?:\.\d+)?)\b", path.read_text("utf-8"))
    }
    assert len(cited) > 30 and cited <= sections, cited - sections


@pytest.mark.parametrize("page", [README_PAGE, RESULTS_PAGE])
def test_the_first_table_says_what_its_scenarios_are(page: Path) -> None:
    """They are remakes without recorded data: whoever reads "V2XPnP" must not take it for the data set."""
    caption = (ROOT / page).read_text("utf-8").partition("<!-- baselines:begin")[0].rpartition("\n## ")[2]
    assert "remakes of our own" in caption and re.search(r"holds? no\s+recorded data", caption)


def test_the_tutorial_says_of_the_realistic_channel_what_it_does() -> None:
    text = (ROOT / "docs/tutorials/02_v2x_agent.ipynb").read_text("utf-8")
    assert ("pose errors" in text) == (PRESETS["realistic"].link.pose_error_m > 0)


def test_a_page_without_the_block_of_a_table_is_refused() -> None:
    with pytest.raises(ValueError, match="expected a block 'speed', found none"):
        replace_block("# Results\n", "speed", "| a |")


def test_a_missed_target_is_shown() -> None:
    missed = {"value": 3.25, "unit": "x", "target": "<= 3.0"}
    rows = format_speed({"tick": missed, "start": {"value": 1.0, "unit": "s", "target": "< 2"}})
    assert "| tick | 3.25 x | <= 3.0: missed |" in rows
    assert "| start | 1 s | < 2 |" in rows


def test_decisions_are_all_listed() -> None:
    folder = ROOT / "docs" / "decisions"
    listed = re.findall(r"\]\((0[^)]+)\)", (folder / "README.md").read_text())
    assert sorted(listed) == sorted(path.name for path in folder.glob("0*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_make_targets_that_are_named_exist(page: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"(?:`| {4})make ([a-z-]+)", page.read_text()))
    assert named <= targets


@pytest.mark.parametrize(("rooms", "lowest"), [("rooms", "core"), ("server", "clock")])
def test_order_of_rooms_in_contributing_is_the_one_that_is_checked(rooms: str, lowest: str) -> None:
    contract = (ROOT / "pyproject.toml").read_text().partition(f'id = "{rooms}"')[2].partition("[[")[0]
    checked = [set(re.findall(r"\w+", layer)) for layer in re.findall(r'^    "(.*)",$', contract, re.MULTILINE)]
    text = (ROOT / "CONTRIBUTING.md").read_text()
    told = re.search(rf"^    {lowest}\b.*?cli$", text, re.MULTILINE | re.DOTALL)
    assert told is not None
    assert [set(re.findall(r"\w+", layer)) for layer in told.group().split("<")] == checked[::-1]


@pytest.mark.parametrize("name", ["README.md", "Makefile", "docker/Dockerfile"])
def test_system_libraries_are_the_same_everywhere(name: str) -> None:
    assert SYSTEM_LIBRARIES in (ROOT / name).read_text()


@pytest.mark.parametrize("what", SCHEMAS)
def test_committed_schemas_are_those_of_the_code(what: str) -> None:
    """After a change on purpose: `make schemas`."""
    assert json.loads((ROOT / "docs" / "schemas" / f"{what}.json").read_text()) == SCHEMAS[what]()


def test_scenario_schema_tells_what_attributes_mean() -> None:
    path = SCHEMAS["scenario"]()["$defs"]["PathMotion"]["properties"]
    assert (path["points"]["description"], path["speed"]["description"]) == (
        "x, y [m] of the box centre.",
        "Target speed [m/s].",
    )


def test_example_of_a_scripted_road_user_is_one() -> None:
    found = re.search(r"```json\n(.*?)```", (ROOT / "docs" / "actors.md").read_text(), re.DOTALL)
    assert found is not None
    actor = Actor.model_validate_json(found.group(1))
    assert isinstance(actor.motion, PathMotion)
    assert actor.referenced_cav_ids == ("0",)


def test_example_of_an_agent_with_cameras_declares_them(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "cameras.md").read_text()
    (found,) = (code for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "class Eyes" in code)
    path = tmp_path / "eyes.py"
    path.write_text(found)
    specs = runpy.run_path(str(path))["Eyes"]({}).sensors()
    assert [(spec.id, str(read_camera_model(spec).kind)) for spec in specs] == [
        ("depth", "depth"),
        ("classes", "semantic"),
    ]


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """The README's agent, saved as a newcomer would."""
    (found,) = (text for text in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if "class Careful" in text)
    path = tmp_path / "my_agent.py"
    path.write_text(found)
    return path


def straight_road() -> Briefing:
    """A route of 50 m along +x."""
    s = np.arange(51.0)
    car = VehicleFacts(4.9, 2.0, 2.8, 1.4, 1800.0, 0.6, 50.0, 3.0, 8.0)
    return Briefing(
        ego_id="0",
        seed=0,
        tick_s=0.05,
        time_limit_s=48.0,
        vehicle=car,
        route_xy=np.column_stack((s, np.zeros(51))),
        route_yaw=np.zeros(51),
        route_s=s,
        route_lane_width=np.full(51, 3.5),
        route_speed_limit=np.full(51, 13.9),
    )


def seen_with_obstacle_at(x: float) -> Observation:
    """The agent stands at the origin, a car stands on its route."""
    one = np.array([1.0])
    car = Objects(("a",), np.zeros(1, dtype=np.uint8), x * one, 0 * one, 0 * one, 0 * one, 4.9 * one, 2 * one)
    return Observation(tick=0, own=OwnState(0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0), objects=car)


def test_readme_agent_answers_with_a_plan_and_stops_for_an_obstacle(example: Path) -> None:
    agent = runpy.run_path(str(example))["Careful"]({"speed": 5.0})
    agent.start(straight_road())
    free = check_reply(agent.act(seen_with_obstacle_at(20.0)), frozenset(CONTROLLERS))
    assert free.plan is not None
    assert free.plan.points[-1] == pytest.approx([10.0, 0.0])  # 10 points of 0.2 s at 5 m/s
    assert agent.act(seen_with_obstacle_at(8.0)).control == STANDSTILL


@pytest.mark.slow
def test_the_agent_of_the_guide_talks_and_drives(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "write-an-agent.md").read_text("utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / "courteous.py").write_text(code)
    episode = md.simulate("i12_ins_sl_old_town", agent=f"{tmp_path / 'courteous.py'}:Courteous")
    assert episode.result.ds == pytest.approx(49.0, abs=0.1)  # the page says so
    assert set(episode.messages_to_frame()["type"]) == {"cam"}


@pytest.mark.slow
def test_readme_agent_drives_the_built_in_suite(example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.json").write_text('{"speed": 6.0}')
    scenario = load_suite("interdrive@0").scenarios[0].id
    command = ("eval", "--suite", "interdrive@0", "--scenario", scenario, "--out", "run")
    agent = ("--agent", f"{example.name}:Careful", "--agent-config", "config.json")
    done = CliRunner().invoke(main, (*command, *agent))
    assert done.exit_code == 0, done.output
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    outcomes = {ego["outcome"] for scenario in results["scenarios"] for ego in scenario["egos"]}
    assert "agent-failed" not in outcomes
    assert results["overall"]["scenario_mean"]["rc"] > 50
