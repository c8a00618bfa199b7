"""`tcp`: counterpart of TCP."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

from mdrive_sumo.agents.learned.control_fusion import ControlFusion
from mdrive_sumo.agents.learned.decided_plan import DecidedPlan
from mdrive_sumo.agents.learned.ego_frame import convert_to_ego
from mdrive_sumo.agents.learned.learned_agent import OPTIONS, LearnedAgent
from mdrive_sumo.contract import Briefing, Observation, Reply
from mdrive_sumo.contract.agent_options import Option


class TcpAgent(LearnedAgent):
    """Counterpart of TCP, trained on mdrive-sumo data: one front camera, answers a plan and a control and blends them.

    Option `fusion` (0: the plan alone, followed by the controller `tracker`).
    """

    system = "tcp"
    options: ClassVar[Mapping[str, Option]] = MappingProxyType({**OPTIONS, "fusion": Option(1, 0, 1, is_switch=True)})

    def start(self, briefing: Briefing) -> None:
        """Prepare the blend besides."""
        super().start(briefing)
        self._fusion = ControlFusion()

    def _build_reply(self, seen: Observation, decided: DecidedPlan) -> Reply:
        if not self._numbers["fusion"]:
            return super()._build_reply(seen, decided)
        points = convert_to_ego(self._sample_plan(seen, decided), seen.own)
        return Reply(control=self._fusion.blend(points, decided.control, seen.own.speed))
