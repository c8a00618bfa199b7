"""An unpacked archive as an agent that may be asked and driven: one description for the server and for dry runs."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from mdrive_sumo.agent_process.child_process import BoxPlan
from mdrive_sumo.agent_process.remote_driver import AgentLimits
from mdrive_sumo.agent_process.sandbox import BoxLimits
from mdrive_sumo.core.state import End
from mdrive_sumo.runs.agent_spec import ANYBODY, Declaration, Hiring, box_text, opened
from mdrive_sumo.runs.job import EpisodeJob
from mdrive_sumo.scoring import ScenarioResult, ScoreMode
from mdrive_sumo.sensing.cameras import describe_camera_error
from mdrive_sumo.sensing.observation_builder import KINDS
from server.archive import ArchiveRefused, Manifest
from server.enums import ChallengeTrack, FailureReason, ScenarioVerdict
from server.environments import RECIPES, Environment

TRACK_BY_LABEL = {
    "single": ChallengeTrack.SINGLE,
    "sharing": ChallengeTrack.SHARING,
    "negotiation": ChallengeTrack.NEGOTIATION,
    "joint": ChallengeTrack.JOINT,
}
"""What an agent calls itself, and the track that it therefore means."""


@dataclass(frozen=True, slots=True)
class SubmittedAgent:
    """What is known of an agent that is to drive here."""

    manifest: Manifest
    folder: Path
    """Where its archive is unpacked."""
    environment: Environment | None
    """None: a plain child of ours, for a user's own agent on their own machine."""
    box: BoxLimits = field(default_factory=BoxLimits)
    limits: AgentLimits = field(default_factory=AgentLimits)
    backend: str = "bubblewrap"

    def plan(self) -> BoxPlan | None:
        """Its box; environments that need more memory than a box usually has get it."""
        if self.environment is None:
            return None
        recipe = RECIPES[self.manifest.environment]
        box = replace(self.box, memory_bytes=max(self.box.memory_bytes, recipe.memory_bytes))
        return BoxPlan(
            folder=str(self.folder),
            python=str(self.environment.python),
            site=str(self.environment.site or ""),
            backend=self.backend,
            rootfs=str(self.environment.rootfs or ""),
            limits=asdict(box),
        )

    def hiring(self) -> Hiring:
        """To ask it what it declares."""
        plan = self.plan()
        if plan is None:
            folder = str(self.folder.absolute())
            return Hiring(self.manifest.locator(folder), self.manifest.agent_config(folder), self.limits)
        return Hiring(self.manifest.entry, self.manifest.agent_config(), self.limits, box_text(plan))

    def job(self, suite_folder: Path, scenario: str, seed: int, recording: str = "", logs: str = "") -> EpisodeJob:
        """To drive one scenario."""
        hiring = self.hiring()
        return EpisodeJob(
            suite_folder=str(suite_folder),
            scenario=scenario,
            agent=hiring.agent,
            agent_config=hiring.config,
            seed=seed,
            score_mode=ScoreMode.MDRIVE,
            recording=recording,
            log_folder=logs,
            limits=hiring.limits,
            box=hiring.box,
        )


def read_declaration(entrant: SubmittedAgent) -> Declaration:
    """What the agent declares, if it may have that. Only from the main thread, if it is in a box.

    Raises ArchiveRefused: the submission is `rejected`; AgentFailure if it cannot even be made; InputError and BoxError
    where it is the box that cannot be had.
    """
    driver = opened(entrant.hiring(), (ANYBODY,))[ANYBODY]  # its InputErrors are about the box
    try:
        found = Declaration(driver.label, driver.sensors())
    finally:
        driver.close()
    if found.label == "privileged" or any(sensor.kind == "privileged" for sensor in found.sensors):
        raise ArchiveRefused(
            "agent: expected sensors that a car can have, found the privileged one, which is not allowed"
        )
    for sensor in found.sensors:
        if sensor.kind not in KINDS:
            unknown = f"sensor {sensor.kind!r:.40}: expected one of {', '.join(KINDS[:-1])}, found none of that kind"
            raise ArchiveRefused(describe_camera_error(sensor.kind) or unknown)
    return found


def find_verdict(result: ScenarioResult) -> tuple[ScenarioVerdict, FailureReason | None]:
    """What became of a scenario; if several CAVs failed the reason is that of the first."""
    failed = [ego for ego in result.egos if ego.outcome == End.AGENT_FAILED]
    if not failed:
        return (ScenarioVerdict.OK if result.status == "ok" else ScenarioVerdict.FAILED_OURS), None
    return ScenarioVerdict.AGENT_FAILED, FailureReason(failed[0].reason.partition(":")[0])
