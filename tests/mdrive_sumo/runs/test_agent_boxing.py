"""`eval --sandbox`: the agent of a file drives in boxes and can read nothing of the suite."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.sandbox_runs import needs_bubblewrap, reachable
from testing.short_suite import make_short_suite

import mdrive_sumo as md
from mdrive_sumo.agent_process.child_process import PACKAGE
from mdrive_sumo.agent_process.sandbox import BoxSpec, open_box
from mdrive_sumo.agent_process.sandbox.bubblewrap import find_hidden_paths
from mdrive_sumo.agents.learned.fusion_spec import TRAINED
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import load_episode
from mdrive_sumo.roads import list_packaged_networks
from mdrive_sumo.runs import agent_boxing
from mdrive_sumo.runs.agent_boxing import box_agent, list_hidden_folders
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scoring import load_results

SCENARIO = "i01_*"
THIEF = """
import json, os
from mdrive_sumo.contract import Control, Note, Reply
SUITE = {suite!r}
def find_files():
    found = []
    for top in ("/agent", "/kit", {networks!r}, {scenarios!r}, SUITE, "/site/mdrive_sumo", "/site/networks"):
        for folder, _, names in os.walk(top):
            found += [os.path.join(folder, name) for name in names if name.endswith((".json", ".gz", ".xml", ".npz"))]
    return found
class Thief:
    label = "single"
    def __init__(self, config): self.config = config
    def sensors(self): return ()
    def start(self, briefing): pass
    def act(self, seen):
        notes = ()
        if seen.tick == 0:
            weights = open(self.config["weights"]).read()
            notes = (Note("found", json.dumps(find_files())), Note("weights", weights))
        return Reply(control=Control(0.5, 0.0, 0.0), notes=notes)
"""


def invoke(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A participant's folder: the agent, its weights, a suite of its own."""
    folder = reachable(tmp_path) / "mine"
    make_short_suite(folder / "suite", SCENARIO)
    (networks,) = {path.parent for path in list_packaged_networks().values()}
    places = {
        "suite": str(folder / "suite"),
        "networks": str(networks),
        "scenarios": str(PACKAGE / "scenarios" / "interdrive"),
    }
    text = THIEF
    for key, place in places.items():
        text = text.replace(f"{{{key}!r}}", repr(place))
    (folder / "thief.py").write_text(text)
    (folder / "weights.txt").write_text("0.5")
    (folder / "config.json").write_text(json.dumps({"weights": str(folder / "weights.txt")}))
    return folder


def drive(folder: Path, *more: str) -> Path:
    agent, out = f"{folder}/thief.py:Thief", folder / "results" / ("boxed" if more else "plain")
    ended = invoke(
        *("eval", "--suite", folder / "suite", "--scenario", SCENARIO, "--agent", agent, "--workers", 1),
        *("--agent-config", folder / "config.json", "--out", out, *more),
    )
    assert ended.exit_code == 0, ended.output
    return out


def stolen(out: Path) -> list[str]:
    (recording,) = (out / "episodes").iterdir()
    notes = [note.note for note in load_episode(recording).notes]
    assert "0.5" in {note.text for note in notes if note.kind == "weights"}
    return json.loads(next(note.text for note in notes if note.kind == "found"))


@needs_bubblewrap
@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_a_boxed_agent_reads_nothing_of_the_suite_and_a_plain_one_does(folder: Path) -> None:
    plain, boxed = drive(folder), drive(folder, "--sandbox")
    assert len(stolen(plain)) > 100
    networks = [*SYSTEMS, *TRAINED, *(f"{name}-encoder" for name in TRAINED)]
    data = [f"agents/learned/weights/{name}.json" for name in networks]
    data += ["agents/memory_drives.npz", "negotiation/dialogue/vocabulary.json"]  # public
    assert set(stolen(boxed)) == {"/agent/config.json", *(f"/kit/mdrive_sumo/{name}" for name in data)}
    plain_results, boxed_results = (load_results(out / "results.json") for out in (plain, boxed))
    assert [one.digest for one in plain_results.scenarios] == [one.digest for one in boxed_results.scenarios]
    assert "unsandboxed" in plain_results.run.labels and "unsandboxed" not in boxed_results.run.labels
    assert boxed_results.run.agent == plain_results.run.agent == "../../thief.py:Thief"
    assert "unsandboxed" in (plain / "report.md").read_text()
    for run, permission in ((boxed, ()), (plain, ("--sandbox",)), (plain, ("--trust-agent",))):
        verified = invoke("verify", run, "--workers", 1, *permission)
        assert (verified.exit_code, "identical" in verified.stdout) == (0, True), verified.output
        where = "with your permissions" if "--trust-agent" in permission else "in boxes"
        assert f"running the agent {folder}/thief.py:Thief" in verified.stderr and where in verified.stderr


@needs_bubblewrap
def test_hidden_folders_are_empty_wherever_they_are_seen(tmp_path: Path) -> None:
    shown = reachable(tmp_path) / "shown"
    for name in ("a/secret", "a/open", "b"):
        (shown / name).mkdir(parents=True)
        (shown / name / "file").write_text(name)
    hidden = (shown / "a" / "secret", tmp_path / "absent", Path("/usr/share"))
    command = ("/bin/sh", "-c", "cd /x; ls */ */*/; ls /usr/share | wc -l; touch a/secret/mine /usr/share/mine")
    spec = BoxSpec(command, {shown: "/x", shown / "a": "/y"}, hidden=hidden)
    assert find_hidden_paths(spec) == ("/usr/share", "/x/a/secret", "/y/secret")
    with open_box(spec) as box:
        box.ready(20.0)
    log = box.log().decode()
    assert log.split("0\n")[0].split() == ["a/:", "open", "secret", "a/open/:", "file", "a/secret/:", "b/:", "file"]
    assert log.count("Read-only file system") == 2


@pytest.mark.parametrize(
    ("agent", "text"),
    [
        ("mdrive_sumo.agents.idm:IdmAgent", "expected path.py:Class or carla:path.py, whose folder a box can show"),
        ("SUITE/agent.py:Agent", "which a box hides"),
        ("nonsense", "expected a built-in name"),
    ],
)
def test_an_agent_that_no_box_can_show_is_refused(agent: str, text: str) -> None:
    suite = find_suite_folder("interdrive@0")
    with pytest.raises(InputError, match=text):
        box_agent(AgentSpec(agent.replace("SUITE", str(suite))), list_hidden_folders(suite), Path("out"))


def test_a_built_in_agent_needs_no_box() -> None:
    assert box_agent(AgentSpec("idm"), (), Path("out")) == AgentSpec("idm")


def test_paths_of_options_are_moved_into_the_box(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(agent_boxing, "_check_machine", lambda: None)
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "w.txt").touch()
    monkeypatch.chdir(tmp_path)
    config = {"a": "data/w.txt", "b": f"{tmp_path}/data", "c": "data/none", "d": "words", "e": 3.0, "f": "/etc/passwd"}
    spec = box_agent(AgentSpec(f"{tmp_path}/x.py:X", config), (), tmp_path / "out")
    assert spec.box is not None and spec.box.hidden == (tmp_path / "out",), "and not the agent's folder"
    moved = {"a": "/agent/data/w.txt", "b": "/agent/data"}
    assert spec.config == {**config, **moved}
    assert (spec.agent, spec.name) == ("/agent/x.py:X", f"{tmp_path}/x.py:X")
    carla = box_agent(AgentSpec(f"carla:{tmp_path}/x.py"), (), tmp_path / "out")
    assert (carla.agent, carla.name) == ("carla:/agent/x.py", f"carla:{tmp_path}/x.py")


def test_a_machine_without_boxes_gets_one_sentence(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    agent_boxing._check_machine.cache_clear()  # pyright: ignore[reportPrivateUsage]
    monkeypatch.setenv("PATH", "/nowhere")
    agent = f"{folder}/thief.py:Thief"
    ended = invoke(
        "eval",
        "--suite",
        "interdrive@0",
        "--scenario",
        SCENARIO,
        "--agent",
        agent,
        "--sandbox",
        "--out",
        folder / "out",
    )
    agent_boxing._check_machine.cache_clear()  # pyright: ignore[reportPrivateUsage]
    assert ended.exit_code == 2 and "Traceback" not in ended.output
    assert "needs the program bwrap, which is not installed here" in ended.output


def test_boxes_and_dask_are_refused(folder: Path) -> None:
    with pytest.raises(InputError, match="--sandbox: expected --executor local"):
        md.evaluate(
            "interdrive@0",
            f"{folder}/thief.py:Thief",
            scenario=SCENARIO,
            sandbox=True,
            scheduler="tcp://x:1",
            progress=False,
        )


def test_a_run_folder_and_a_fingerprint_know_the_sandbox() -> None:
    plain = RunConfig(agent=AgentSpec("idm"))
    boxed = replace(plain, sandbox=True)
    assert RunConfig.from_dict(boxed.to_dict()).sandbox
    assert boxed.default_folder("s") != plain.default_folder("s")
    assert not RunConfig.from_dict({key: value for key, value in plain.to_dict().items() if key != "sandbox"}).sandbox
