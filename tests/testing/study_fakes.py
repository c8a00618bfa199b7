"""A stand-in for `run_job` whose score depends on the channel as a study should find it. No tests in here."""

from mdrive_sumo import cli
from mdrive_sumo.core.state import End
from mdrive_sumo.runs import evaluate
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import EgoResult, ScenarioResult, make_void_result
from mdrive_sumo.v2x.comm_settings import format_comm_json
from testing.pool_fakes import Task, perform


def drive(job: EpisodeJob) -> ScenarioResult:
    """Omniscient has DS 90, idm 30 and says nothing; all others have 70 less latency, 40 x loss and 10 x pose error.

    Without a channel they have 30; the second seed adds 1. The deed in the scenario's description is done first.
    """
    folder, agent, comm = job.suite_folder, job.agent.name, job.options.comm
    with (folder / "calls").open("a") as calls:
        calls.write(f"{agent} {format_comm_json(comm)} {job.seed} {job.scenario}\n")
    scenario = next(s for s in load_suite(str(job.suite_folder)).scenarios if s.id == job.scenario)
    perform(Task(job.scenario, scenario.description, str(folder)))
    link = comm.link
    talking = 70.0 - link.latency_ticks - 40.0 * link.loss - 10.0 * link.pose_error_m if comm.on else 30.0
    score = {"omniscient": 90.0, "idm": 30.0}.get(agent, talking) + job.seed
    said = {} if agent in ("omniscient", "idm") else {"sent": 1, "bytes": 4}
    if job.recording:
        job.recording.write_text("recorded")
    return _make_result(scenario, job.seed, score).model_copy(update={"comm": said})


def _make_result(scenario: Scenario, seed: int, score: float) -> ScenarioResult:
    """A result with this DS and half of it as SR: of 200 CAVs as many succeed as DS says, the others are alike."""
    succeed = round(score)
    rest = (200 * score - 100 * succeed) / (200 - succeed)
    egos = tuple(
        EgoResult(id=str(i), outcome=End.BLOCKED, reason="", ds=rc, rc=rc, ip=1.0, ticks=1, infractions=())
        for i, rc in enumerate([100.0] * succeed + [rest] * (200 - succeed))
    )
    return make_void_result(scenario, seed, "").model_copy(
        update={"status": "ok", "ds": score, "sr": succeed / 2, "rc": score, "ip": 1.0, "ticks": 1, "egos": egos}
    )


def main() -> None:
    """The command line with `drive` in place of the simulation."""
    evaluate.run_job = drive
    cli.main()
