"""`run_submission_job` with real boxes and a real simulation: verdicts, files, usage, what each track lets through."""

import json
import shutil
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from testing import evaluation_fakes
from testing.archive_samples import packed
from testing.dask_cluster import cluster
from testing.sandbox_runs import needs_bubblewrap
from testing.small_environment import describe_small_environment

from mdrive_sumo.agent_process.sandbox import check_layers
from mdrive_sumo.agent_process.sandbox.private_files import remove_idle_files
from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.episode import load_episode
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.executor import run_jobs
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.v2x.channel import DeliveryStatus
from server import environments
from server.enums import ChallengeTrack, JobKind, ScenarioVerdict
from server.evaluation.cross_play import compute_score
from server.evaluation.job_task import AgentRejection, JobTask, OtherArchive
from server.evaluation.submission_job import run_submission_job
from server.settings import ArchiveSettings, SandboxSettings
from server.store.jobs import JobOutcome
from server.tracks import COMM_BY_TRACK

SCENARIO, OTHER = "i07_ins_ss_town", "i01_ins_c_main_street_right"
pytestmark = [
    pytest.mark.slow,
    needs_bubblewrap,
]

DRIVER = """
from mdrive_sumo.contract import Control, Message, Reply, SensorSpec
from mdrive_sumo.v2x.messages import Cam, ReferencePose, encode

class Agent:
    label = "negotiation"
    def __init__(self, config):
        print("config", sorted(config))
    def sensors(self):
        return (SensorSpec({sensor!r}),)
    def start(self, briefing):
        self.briefing = briefing
    def act(self, seen):
        if seen.tick == {dies}:
            raise ValueError("no more")
        messages = () if seen.tick % 10 else {messages}
        return Reply(control=Control(0.5, 0.0, 0.0), messages=messages)
"""


def team(sensor: str = "objects", dies: int = -1, messages: str = "()", **files: str) -> bytes:
    """An archive of one agent."""
    source = DRIVER.format(sensor=sensor, dies=dies, messages=messages)
    told: Mapping[str, str] = {"agents.py": source, "model_env.yaml": "environment: python3.11-numpy\n"} | files
    return packed({name: text.encode() for name, text in told.items()})


def task(data: Path, archive: bytes, **changed: Any) -> JobTask:
    """As the dispatcher makes it, with the environment of this Python."""
    sha = sha256(archive).hexdigest()
    (data / "archives").mkdir(exist_ok=True)
    (data / "archives" / f"{sha}.zip").write_bytes(archive)
    about = data / "environments" / "python3.11-numpy"
    about.mkdir(parents=True, exist_ok=True)
    (about / "environment.json").write_text(json.dumps(asdict(environments.current_environment()), default=str))
    made = JobTask(
        job=1,
        attempt=1,
        submission="ab" * 16,
        archive_sha256=sha,
        environment="python3.11-numpy",
        track=ChallengeTrack.SINGLE,
        suite="interdrive",
        scenario=SCENARIO,
        seed=0,
        public=True,
        data=data,
        sandbox=evaluation_fakes.SHARED,
        limits=ArchiveSettings(),
    )
    return replace(made, **changed)


def driven(wanted: JobTask) -> JobOutcome:
    found = run_submission_job(wanted)
    assert isinstance(found, JobOutcome), found
    return found


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> tuple[JobTask, JobOutcome]:
    """The drive of the plain agent, in boxes that share files."""
    wanted = task(tmp_path_factory.mktemp("plain"), team())
    return wanted, driven(wanted)


def test_the_result_is_that_of_eval_and_the_boxes_are_accounted_for(plain: tuple[JobTask, JobOutcome]) -> None:
    wanted, outcome = plain
    assert outcome.verdict is ScenarioVerdict.OK
    again = EpisodeJob(
        suite_folder=Path(environments.__file__).parents[1] / "mdrive_sumo" / "scenarios" / "interdrive",
        scenario=SCENARIO,
        agent=AgentSpec(f"{wanted.unpacked / 'agent' / 'agents.py'}:Agent"),
        options=EpisodeOptions(comm=COMM_BY_TRACK[ChallengeTrack.SINGLE]),
    )
    assert outcome.result == run_job(again).model_dump(mode="json")
    used = outcome.usage
    assert used is not None and outcome.result is not None
    assert used["layers"] == [layer for layer in check_layers(()) if layer != "private-files"] != []
    assert {box["backend"] for box in used["boxes"].values()} == {"bubblewrap"}
    assert sum(used["latency"]["counts"]) == sum(box["answers"] for box in used["boxes"].values()) > 100
    assert len(used["latency"]["counts"]) == len(used["latency"]["ends_ms"]) + 1
    assert used["peak_memory_bytes"] > 2**20
    assert 0 < used["cpu_s"] < 600
    assert sorted(path.name for path in wanted.stage.iterdir()) == sorted(
        [f"{SCENARIO}.npz", *(f"{SCENARIO}.{cav}.log" for cav in used["boxes"])]
    )
    assert (wanted.stage / f"{SCENARIO}.0.log").read_text() == "config []\n"
    assert load_episode(wanted.stage / f"{SCENARIO}.npz").digest == outcome.result["digest"]


def test_an_agent_that_fails_is_scored_and_of_hidden_phases_no_file_is_left(tmp_path: Path) -> None:
    outcome = driven(task(tmp_path, team(dies=5), public=False))
    assert (outcome.verdict, outcome.reason) == (ScenarioVerdict.AGENT_FAILED, FailureReason.CRASHED)
    assert outcome.result is not None
    assert outcome.usage is not None
    assert outcome.usage["boxes"]["0"]["answers"] == 5
    assert list((tmp_path / "stage").iterdir()) == []
    assert not (tmp_path / "recordings").exists()


def test_what_an_agent_may_not_have_rejects_it(tmp_path: Path) -> None:
    found = run_submission_job(task(tmp_path, team(sensor="privileged")))
    assert isinstance(found, AgentRejection)
    assert found.why.startswith("sensor 'privileged': expected sensors that a car can have")
    found = run_submission_job(task(tmp_path, team(), track=ChallengeTrack.JOINT))
    assert found == AgentRejection(
        "track joint: expected one agent for all CAVs (get_entry_point) in agents.py, found an agent for each CAV"
    )
    lists = replace(task(tmp_path, team(dies=5)), sensor_track_only=True)
    found = run_submission_job(lists)
    assert isinstance(found, AgentRejection) and found.why.startswith("agent: expected sensors of the sensor track")
    carried = driven(replace(task(tmp_path, team(sensor="gnss", dies=5)), sensor_track_only=True)).result
    assert carried is not None and carried["sensing_track"] == "sensor"
    found = run_submission_job(task(tmp_path, b"no zip"))
    assert isinstance(found, AgentRejection)
    assert found.why.startswith("archive: ")


def test_two_agents_drive_in_boxes_of_their_own_and_each_answers_for_its_cavs(tmp_path: Path) -> None:
    """Archives that each crash after a number of answers of their own: both are told apart, in either role."""
    twelve, five = task(tmp_path, team(dies=12)), task(tmp_path, team(dies=5))
    for first, second, answered in ((twelve, five, (12, 5)), (five, twelve, (5, 12))):
        other = OtherArchive(second.archive_sha256, second.environment)
        pair = {"kind": JobKind.CROSS_PLAY, "track": ChallengeTrack.NEGOTIATION, "other": other}
        outcome = driven(replace(first, **pair))
        result = ScenarioResult.model_validate(outcome.result)
        assert compute_score(result).tested_failed and compute_score(result).others_failed
        assert outcome.usage is not None
        boxes = outcome.usage["boxes"]
        assert [sum(ego.is_other for ego in result.egos), len(boxes)] == [len(boxes) - 1, len(result.egos)]
        assert {boxes[ego.id]["answers"] for ego in result.egos if not ego.is_other} == {answered[0]}
        assert {boxes[ego.id]["answers"] for ego in result.egos if ego.is_other} == {answered[1]}
        assert list((tmp_path / "stage").iterdir()) == [] and not (tmp_path / "recordings").exists()


@pytest.mark.parametrize(
    ("track", "arrives"),
    [
        (ChallengeTrack.SINGLE, set()),
        (ChallengeTrack.SHARING, {"cam"}),
        (ChallengeTrack.NEGOTIATION, {"cam", "text", "own"}),
    ],
)
def test_a_track_decides_what_arrives(tmp_path: Path, track: ChallengeTrack, arrives: set[str]) -> None:
    cam = "encode(Cam(ReferencePose(seen.own.x, seen.own.y, seen.own.yaw, seen.tick), 1.0, 0.0, 0.0, 4.5, 2.0))"
    said = f'({cam}, Message("text", b"after you"), Message("own", b"x"))'
    wanted = task(tmp_path, team(dies=25, messages=said), track=track)  # three messages later
    assert driven(wanted).reason is FailureReason.CRASHED
    fates: Counter[tuple[str, bool]] = Counter()
    for sent in load_episode(wanted.stage / f"{SCENARIO}.npz").messages:
        fates.update((sent.message.type, fate == DeliveryStatus.DELIVERED) for fate, _ in sent.deliveries.values())
    assert {kind for kind, _ in fates} == {"cam", "text", "own"}
    assert {kind for kind, delivered in fates if delivered} == arrives


def test_an_agent_finds_no_packages_but_its_environment_s(tmp_path: Path) -> None:
    told = "import sys\nprint(sys.flags.no_site, [path for path in sys.path if path.endswith('-packages')])\n"
    source = told + DRIVER.format(sensor="objects", dies=0, messages="()")
    wanted = task(tmp_path, team(**{"agents.py": source}), scenario=OTHER)
    driven(wanted)
    assert (wanted.stage / f"{OTHER}.0.log").read_text().startswith("1 []\n")


def test_what_happens_to_an_archive_on_our_disk_is_not_the_team_s_fault(tmp_path: Path) -> None:
    wanted = task(tmp_path, team())
    wanted.archive.write_bytes(b"PK")
    with pytest.raises(WorldError, match=r"\.zip: expected the bytes of the submission, found others$"):
        run_submission_job(wanted)
    wanted.archive.unlink()
    with pytest.raises(FileNotFoundError):
        run_submission_job(wanted)
    assert not wanted.unpacked.exists()


@pytest.mark.timeout(600)
@pytest.mark.full
def test_a_cluster_drives_boxes_as_this_machine_does(tmp_path: Path) -> None:
    local = task(tmp_path, team(), scenario=OTHER)
    elsewhere = replace(local, job=2)
    (tmp_path / "dask").mkdir()
    with cluster(tmp_path / "dask", workers=1) as own, make_executor(run_submission_job, 1, 300.0, own.address) as dask:
        [(_, there)] = run_jobs(dask, [elsewhere])
    assert isinstance(there, JobOutcome), there
    here = driven(local)
    assert here.result == there.result
    recorded = [(one.stage / f"{OTHER}.npz").read_bytes() for one in (local, elsewhere)]
    assert recorded[0] == recorded[1]


@pytest.mark.skipif(shutil.which("runsc") is None, reason="needs gVisor's runsc")
def test_an_agent_with_a_kernel_of_its_own_drives_as_one_without(
    tmp_path: Path, plain: tuple[JobTask, JobOutcome]
) -> None:
    """What `auto` takes where it can; each CAV of the scenario has a kernel, and a hidden phase may use it."""
    settings = SandboxSettings(required=("own-kernel",))
    wanted = task(tmp_path, team(), sandbox=settings, public=False)
    describe_small_environment(tmp_path / "environments" / "python3.11-numpy")
    found, shared = driven(wanted), plain[1]
    assert found.result == shared.result and found.usage is not None and shared.usage is not None
    assert (found.usage["backend"], shared.usage["backend"]) == ("gvisor", "bubblewrap")
    assert "own-kernel" in found.usage["layers"] and "own-kernel" not in shared.usage["layers"]
    assert {box["backend"] for box in found.usage["boxes"].values()} == {"gvisor"}
    assert not any(box["repeated"] for box in found.usage["boxes"].values())


def test_a_hidden_scenario_is_not_driven_in_a_box_that_shares_its_kernel(
    tmp_path: Path, plain: tuple[JobTask, JobOutcome]
) -> None:
    """Whatever the server has checked: the machine of a cluster may have no gVisor.

    A spot check of a public phase is not concerned.
    """
    refused = evaluation_fakes.SHARED.model_copy(update={"hidden_on_shared_kernel": False})
    wanted = task(tmp_path, team(), sandbox=refused)
    with pytest.raises(InputError, match=r"^hidden phases: expected boxes with a kernel each"):
        run_submission_job(replace(wanted, public=False))
    assert driven(replace(wanted, kind=JobKind.SPOT_CHECK)).result == plain[1].result


@pytest.mark.full  # in `make test`: test_sandbox_channels and test_sandbox_layers make such boxes
def test_an_agent_with_files_of_its_own_drives_as_one_without(
    tmp_path: Path, plain: tuple[JobTask, JobOutcome]
) -> None:
    """The server's default; the digest is that of boxes that share files."""
    place = tmp_path / "copies"
    place.mkdir()
    settings = evaluation_fakes.SHARED.model_copy(update={"required": ("private-files", "proc"), "copies": place})
    wanted = task(tmp_path, team(), sandbox=settings)
    describe_small_environment(tmp_path / "environments" / "python3.11-numpy")
    private, shared = driven(wanted), plain[1]
    assert private.usage is not None and private.result is not None and shared.result is not None
    assert "private-files" in private.usage["layers"]
    assert private.result["digest"] == shared.result["digest"]
    assert [path.name for path in place.glob("*/*/system-*")] != []
    remove_idle_files(place)
