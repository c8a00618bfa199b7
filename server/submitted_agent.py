"""An unpacked archive as an agent that can be inspected and run, on the server and in dry runs."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from mdrive_sumo.agent_process.child_process import AgentBox
from mdrive_sumo.agent_process.remote_driver import AgentLimits
from mdrive_sumo.agent_process.reply_decoding import AgentDeclaration
from mdrive_sumo.agent_process.sandbox import BoxLimits
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.open_agents import RejectedError, declare_agent
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.sensing.camera.camera_renderer import check_renderer
from mdrive_sumo.sensing.sensor_kinds import SENSOR_KINDS, check_sensor_budget, describe_camera_error
from server.archive import ArchiveRefused, Manifest
from server.enums import ChallengeTrack, ScenarioVerdict
from server.environments import RECIPES, Environment

TRACK_BY_LABEL = {
    "single": ChallengeTrack.SINGLE,
    "sharing": ChallengeTrack.SHARING,
    "negotiation": ChallengeTrack.NEGOTIATION,
    "joint": ChallengeTrack.JOINT,
}
"""Track that corresponds to the label that an agent declares."""


@dataclass(frozen=True, slots=True)
class SubmittedAgent:
    """An unpacked agent and the sandbox that it runs in."""

    manifest: Manifest
    folder: Path
    """Folder with its unpacked archive."""
    environment: Environment | None
    """None: a plain child process, for a user's own agent on their own machine."""
    box: BoxLimits = field(default_factory=BoxLimits)
    limits: AgentLimits = field(default_factory=AgentLimits)
    backend: str = "bubblewrap"
    copies: Path | None = None
    """Folder for the files of each sandbox; None: sandboxes share those of the host."""

    def agent_box(self) -> AgentBox | None:
        """Return its sandbox, with the memory that its environment needs; None for a plain child process."""
        if self.environment is None:
            return None
        recipe = RECIPES[self.manifest.environment]
        return AgentBox(
            folder=self.folder,
            python=str(self.environment.python),
            site=self.environment.site,
            backend=self.backend,
            rootfs=self.environment.rootfs,
            copies=self.copies,
            limits=replace(self.box, memory_bytes=max(self.box.memory_bytes, recipe.memory_bytes)),
        )

    def agent_spec(self) -> AgentSpec:
        """Return the agent for a run."""
        box = self.agent_box()
        if box is None:
            folder = str(self.folder.absolute())
            return AgentSpec(self.manifest.locator(folder), self.manifest.agent_config(folder), self.limits)
        return AgentSpec(self.manifest.entry, self.manifest.agent_config(), self.limits, box)


def read_declaration(agent: SubmittedAgent) -> AgentDeclaration:
    """Start the agent and return its declaration. A sandboxed agent needs the main thread.

    Raises ArchiveRefused if a declared sensor is not allowed (the submission is `rejected`); AgentFailure if the agent
    cannot be created; InputError and BoxError if the sandbox cannot be opened.
    """
    try:
        declaration = declare_agent(agent.agent_spec())
    except RejectedError as error:
        raise ArchiveRefused(str(error)) from None
    if declaration.label == "privileged" or any(sensor.kind == "privileged" for sensor in declaration.sensors):
        raise ArchiveRefused(
            "agent: expected sensors that a car can have, found the privileged one, which is not allowed"
        )
    for sensor in declaration.sensors:
        if sensor.kind not in SENSOR_KINDS:
            allowed = ", ".join(name for name, kind in SENSOR_KINDS.items() if not kind.knows_everything)
            unknown = f"sensor {sensor.kind!r:.40}: expected one of {allowed}, found none of that kind"
            raise ArchiveRefused(describe_camera_error(sensor.kind) or unknown)
    try:
        check_sensor_budget(declaration.sensors)
        check_renderer(declaration.sensors)
    except InputError as error:
        raise ArchiveRefused(str(error)) from None
    return declaration


def find_verdict(result: ScenarioResult) -> tuple[ScenarioVerdict, FailureReason | None]:
    """Return the verdict on a result, and the failure reason of the first CAV whose agent failed."""
    failed = [ego for ego in result.egos if ego.outcome == End.AGENT_FAILED]
    if not failed:
        return (ScenarioVerdict.OK if result.status == "ok" else ScenarioVerdict.FAILED_OURS), None
    return ScenarioVerdict.AGENT_FAILED, FailureReason(failed[0].reason.partition(":")[0])
