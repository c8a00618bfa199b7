"""Joint agents: one program drives all CAVs of a scenario, as in the original code base. Labelled `joint` in results.

Its CAVs share all knowledge without a channel, so they are ranked separately. An agent of the CARLA leaderboard for one
vehicle is a program of this kind with a single CAV.
"""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from mdrive_sumo.agent_process import reply_decoding
from mdrive_sumo.agent_process.agent_connection import AgentConnection
from mdrive_sumo.agent_process.remote_driver import SensorCheck
from mdrive_sumo.agent_process.wire_protocol import CREATE_TICK, START_TICK
from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.sensing.navigation_sensors import to_gnss

LABEL = "joint"


class JointAgentSession:
    """One agent process for all CAVs; `drivers` maps each CAV id to its AgentDriver, in the order of the CAVs.

    It gets one request per tick with the observations of all CAVs that are asked in that tick. If it fails, all CAVs
    fail; if its reply for one CAV is invalid, that CAV fails.
    """

    def __init__(
        self,
        line: AgentConnection,
        config: Mapping[str, Any],
        pseudonyms: Mapping[str, str],
        check: SensorCheck | None = None,
        label: str = LABEL,
    ) -> None:
        """Take ownership of the connection.

        pseudonyms: the id by which the program knows each CAV, by CAV. check: raises an exception for refused sensors.
        label: of the drivers.
        """
        self._line, self._pseudonyms, self._check_sensors = line, dict(pseudonyms), check
        self._declared: reply_decoding.AgentDeclaration | None = None
        self._failure: AgentFailure | None = None
        self._briefings: dict[str, Briefing] = {}
        self._asked: dict[str, Observation] = {}
        self._requested: tuple[str, ...] = ()
        self._answers: dict[str, object] = {}
        self.think_time_s = 0.0
        self.drivers = {ego: JointDriver(self, ego, told, label) for ego, told in self._pseudonyms.items()}
        with self._keeping_failure():
            line.send("create", CREATE_TICK, {"config": dict(config), "cavs": tuple(self._pseudonyms.values())})

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensors of every CAV."""
        self._check()
        if self._declared is None:
            with self._keeping_failure():
                self._declared = self._line.receive(reply_decoding.read_declaration)
        self._check()
        assert self._declared is not None
        if self._check_sensors is not None:
            self._check_sensors(self._declared.sensors)
        return self._declared.sensors

    def brief(self, told: str, briefing: Briefing) -> None:
        """Keep the briefing of a CAV, given by its pseudonym; the program is briefed when all CAVs are."""
        self._check()
        self._briefings[told] = briefing
        if len(self._briefings) == len(self._pseudonyms):
            gps = {told: _to_gnss_points(briefing) for told, briefing in self._briefings.items()}
            with self._keeping_failure():
                self._line.send("start", START_TICK, {"briefings": self._briefings, "gps": gps})
                self._line.receive(reply_decoding.read_none)
            self._check()

    def ask(self, told: str, observation: Observation) -> None:
        """Keep an observation of a CAV, given by its pseudonym, until all of the tick are there."""
        self._check()
        self._asked[told] = observation

    def send(self) -> None:
        """Send the observations of all CAVs that were asked, in one request."""
        if self._asked:
            self._check()
            asked, self._asked = self._asked, {}
            self._requested = tuple(asked)
            with self._keeping_failure():
                self._line.send("act", next(iter(asked.values())).tick, asked)

    def answer(self, told: str) -> Reply:
        """Return the reply for one CAV, given by its pseudonym."""
        self.send()
        if self._requested:
            self._receive_replies()
        self._check()
        return reply_decoding.read_reply(self._answers.pop(told))

    def close(self) -> None:
        """End the program."""
        self._line.close()

    def usage_record(self) -> Mapping[str, Any]:
        """See `AgentConnection.usage_record`."""
        return self._line.usage_record()

    def _receive_replies(self) -> None:
        self._check()
        told, self._requested = self._requested, ()
        with self._keeping_failure():
            self._answers = dict(self._line.receive(lambda value: reply_decoding.read_replies_by_ego(value, told)))
            self.think_time_s = self._line.think_times_s[-1]

    @contextmanager
    def _keeping_failure(self) -> Generator[None]:
        """Keep a failure for all CAVs, whose later calls raise it, instead of raising it for one."""
        try:
            yield
        except AgentFailure as error:
            self._failure = error

    def _check(self) -> None:
        if self._failure is not None:
            raise AgentFailure(self._failure.failure, self._failure.text)


class JointDriver:
    """The AgentDriver of one CAV of a joint agent."""

    def __init__(self, session: JointAgentSession, ego: str, told: str, label: str = LABEL) -> None:
        self._session, self._ego, self._told = session, ego, told
        self.label = label

    @property
    def think_time_s(self) -> float:
        """See AgentDriver: the whole program's time."""
        return self._session.think_time_s

    def sensors(self) -> tuple[SensorSpec, ...]:
        """See AgentDriver."""
        return self._session.sensors()

    def start(self, briefing: Briefing) -> None:
        """See AgentDriver."""
        self._session.brief(self._told, briefing)

    def ask(self, observation: Observation) -> None:
        """See AgentDriver."""
        self._session.ask(self._told, observation)

    def send(self) -> None:
        """See AgentDriver: the first call sends the observations of all CAVs."""
        self._session.send()

    def answer(self) -> Reply:
        """See AgentDriver."""
        try:
            return self._session.answer(self._told)
        except reply_decoding.InvalidReplyError as error:
            raise AgentFailure(FailureReason.INVALID, f"{self._ego}: {error}") from None

    def close(self) -> None:
        """See AgentDriver: closing one closes all, because the loop closes them only after the last tick."""
        self._session.close()


def _to_gnss_points(briefing: Briefing) -> Any:
    """Return the route (N, 3): latitude and longitude [degrees], altitude [m]."""
    points = [to_gnss(x, y) for x, y in briefing.route_xy.tolist()]
    return np.array([(point.latitude_deg, point.longitude_deg, point.altitude_m) for point in points])
