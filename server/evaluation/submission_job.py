"""Runs one job of a submission: sandboxed agents, episode, score."""

import json
import shutil
import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import lru_cache
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

from mdrive_sumo.agent_process.agent_connection import HISTOGRAM_MS
from mdrive_sumo.agent_process.sandbox import check_shared_kernel
from mdrive_sumo.agent_process.sandbox.cgroups import join_episode_group
from mdrive_sumo.contract import SensingTrack
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.open_agents import RejectedError
from mdrive_sumo.runs.other_agents import OtherAgents
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scenario.season import read_stored_name
from server.archive import ArchiveRefused
from server.environments import load_environment
from server.evaluation.archive_cache import unpack_archive
from server.evaluation.cross_play import is_failure_by_messages
from server.evaluation.job_task import BY_MESSAGES, AgentRejection, JobResult, JobTask
from server.evaluation.machine_check import SHARED_KERNEL_SETTING, find_layers
from server.evaluation.thinking_times import THINKING
from server.store.jobs import JobOutcome
from server.store.overviews import MAX_RESULT_BYTES, count_bytes
from server.submitted_agent import SubmittedAgent, find_verdict
from server.tracks import COMM_BY_TRACK, check_style

MAX_RECORDING_BYTES = 4 * 1024 * 1024
"""Larger recordings are dropped: packaged scenarios need up to 0.5 MB, the rest is messages of agents [bytes]."""
_USAGE = (
    *("backend", "repeated", "answers", "exit_code", "signal", "oom_killed"),
    *("peak_memory_bytes", "cpu_s", "wall_s", "clean"),
)
"""What is kept of the record of a box."""


def run_submission_job(task: JobTask) -> JobResult:
    """Run and score one scenario. Needs the main thread of its process, as sandboxes do.

    Raises on failures on our side: InputError (the machine lacks a sandbox layer, an environment is not built),
    WorldError, OSError.
    """
    _join_group(task.sandbox.episode_memory_bytes)
    task = _choose_backend(task)
    _find_task_layers(task)
    agents: list[SubmittedAgent] = []
    others = [] if task.other is None else [replace(task, **asdict(task.other))]
    for driver in (task, *others):
        try:
            agents.append(_load_agent(driver))
        except ArchiveRefused as error:
            return AgentRejection(str(error))
        try:
            check_style(agents[-1].manifest.style, task.track)
        except InputError as error:
            return AgentRejection(str(error))
    make_folder(task.stage)
    try:
        return _run_agents(task, *agents)
    finally:
        if not task.keeps_files:
            shutil.rmtree(task.stage, ignore_errors=True)


@lru_cache(maxsize=1)
def _join_group(memory_bytes: int) -> bool:
    """Put a worker's process into a control group, once; where there are none, the layer `cgroup` is absent too."""
    return parent_process() is not None and join_episode_group(memory_bytes)


def _choose_backend(task: JobTask) -> JobTask:
    """Return the task with the backend of this machine. Raises InputError if a hidden scenario must not run on it."""
    backend = task.sandbox.choose_backend()
    if not task.public:
        check_shared_kernel(backend, may_share=task.sandbox.hidden_on_shared_kernel, setting=SHARED_KERNEL_SETTING)
    return replace(task, sandbox=task.sandbox.model_copy(update={"backend": backend}))


def _find_task_layers(task: JobTask) -> tuple[str, ...]:
    """Return the layers of this task's sandboxes; they may lack copies that this machine could make."""
    layers = find_layers(task.sandbox.required, task.sandbox.backend, task.sandbox.copies)
    return tuple(name for name in layers if name != "private-files" or task.sandbox.copies_folder() is not None)


def _run_agents(task: JobTask, agent: SubmittedAgent, other: SubmittedAgent | None = None) -> JobResult:
    start_s = time.monotonic()
    job = _make_job(task, agent, other)
    try:
        result = run_job(job)
    except RejectedError as error:
        return AgentRejection(str(error))
    if task.sensor_track_only and result.sensing_track == SensingTrack.OBJECT:
        return AgentRejection(
            "agent: expected sensors of the sensor track, which this phase is for, found one that lists objects"
        )
    recording = task.stage / f"{task.scenario}.npz"
    if recording.is_file() and recording.stat().st_size > MAX_RECORDING_BYTES:
        recording.unlink()
    content = result.model_dump(mode="json")
    if (size := count_bytes(content)) > MAX_RESULT_BYTES:
        return AgentRejection(f"{task.scenario}: expected a result of at most {MAX_RESULT_BYTES} bytes, found {size}")
    verdict, reason = find_verdict(result)
    blamed = {BY_MESSAGES: True} if other is not None and is_failure_by_messages(job, result, task.stage) else {}
    wall_s = round(time.monotonic() - start_s, 3)
    layers = _find_task_layers(task)
    used = {"wall_s": wall_s, "layers": list(layers), **collect_usage(task.stage), **blamed}
    return JobOutcome(verdict, content, reason, used)


def _load_agent(task: JobTask) -> SubmittedAgent:
    manifest, folder = unpack_archive(task)
    sandbox = task.sandbox
    return SubmittedAgent(
        manifest,
        folder,
        load_environment(manifest.environment, task.data / "environments"),
        sandbox.box_limits(),
        sandbox.line_limits(),
        sandbox.backend,
        sandbox.copies_folder(),
    )


def _make_job(task: JobTask, agent: SubmittedAgent, other: SubmittedAgent | None) -> EpisodeJob:
    return EpisodeJob(
        suite_folder=find_suite_folder(read_stored_name(task.suite)).absolute(),
        scenario=task.scenario,
        agent=agent.agent_spec(),
        others=OtherAgents(other.agent_spec()) if other is not None else None,
        seed=task.seed,
        options=EpisodeOptions(comm=COMM_BY_TRACK[task.track]),
        recording=task.stage / f"{task.scenario}.npz" if task.keeps_files else None,
        logs=task.stage,
        checksum=task.checksum,
    )


def collect_usage(folder: Path) -> dict[str, Any]:
    """Return the resource usage of a job's sandboxes by CAV, from the records in `folder`, which are deleted.

    `latency` is a histogram of reply times: `counts[i]` up to `ends_ms[i]`, the last one above all ends. `thinking` is
    for organisers, see `thinking_times`.
    """
    records: dict[str, Mapping[str, Any]] = {}
    for path in sorted(folder.glob("*.json")):
        records[path.name.removesuffix(".json").rpartition(".")[2]] = json.loads(read_text(path))
        path.unlink()
    thoughts = [record["thought_ms"] for record in records.values()]
    counts = [sum(column) for column in zip(*(thought["counts"] for thought in thoughts), strict=True)]
    return {
        "latency": {"ends_ms": list(HISTOGRAM_MS), "counts": counts},
        "latency_p99_ms": max((thought["p99"] for thought in thoughts if thought["p99"] is not None), default=None),
        "peak_memory_bytes": max((record.get("peak_memory_bytes") or 0 for record in records.values()), default=None),
        "cpu_s": round(sum(record.get("cpu_s") or 0.0 for record in records.values()), 3),
        "backend": ", ".join(sorted({record["backend"] for record in records.values()})),
        "boxes": {name: {key: record[key] for key in _USAGE if key in record} for name, record in records.items()},
        THINKING: {
            name: {key: record["thought_ms"].get(key) for key in ("modes", "late")} for name, record in records.items()
        },
    }
