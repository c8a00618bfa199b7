"""`stationary`: never moves."""

from mdrive_sumo.contract import STANDSTILL, Briefing, Cause, Observation, Reason, ReasonLog, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, read_options


class StationaryAgent:
    """Stands at its start with the brake on: the lower bound of every score."""

    label = "single"

    def __init__(self, config: Config) -> None:
        read_options("stationary", config, {})

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return no sensor."""
        return ()

    def start(self, briefing: Briefing) -> None:  # noqa: ARG002 - the protocol's signature
        """Begin a new episode."""
        self._reasons = ReasonLog()

    def act(self, seen: Observation) -> Reply:  # noqa: ARG002 - the protocol's signature
        """Return full braking."""
        return Reply(control=STANDSTILL, notes=self._reasons.record(Reason(Cause.STATIONARY)))
