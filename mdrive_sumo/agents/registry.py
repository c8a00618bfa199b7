"""The built-in agents by name; the first docstring line of a class is the description of the agent."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import cast

from mdrive_sumo.contract.agent_options import AgentFactory


class AgentTable(Mapping[str, AgentFactory]):
    """Agents by name. The module of an agent is imported when the agent is asked for, because most runs need one."""

    def __init__(self, place_by_name: Mapping[str, str]) -> None:
        """place_by_name: module below this package, a colon and the class."""
        self._place_by_name = dict(place_by_name)

    def __getitem__(self, name: str) -> AgentFactory:
        module, _, class_name = self._place_by_name[name].partition(":")
        return cast(AgentFactory, getattr(import_module(f"{__package__}.{module}"), class_name))

    def __contains__(self, name: object) -> bool:
        """Return whether there is an agent of that name, without importing it as `Mapping` would."""
        return name in self._place_by_name

    def __iter__(self) -> Iterator[str]:
        return iter(self._place_by_name)

    def __len__(self) -> int:
        return len(self._place_by_name)


_LEARNED = {
    "tcp": "learned.tcp:TcpAgent",
    "lmdrive": "learned.learned_agent:LmdriveAgent",
    "uniad": "learned.learned_agent:UniadAgent",
    "vad": "learned.learned_agent:VadAgent",
}
LEARNED_AGENTS = AgentTable(_LEARNED)
"""Counterparts of the paper's systems."""
_DETECTORS = {
    "perception-swap:attfuse": "learned.detector_agent:AttFuseAgent",
    "perception-swap:disconet": "learned.detector_agent:DiscoNetAgent",
    "perception-swap:fcooper": "learned.detector_agent:FCooperAgent",
    "perception-swap:cobevt": "learned.detector_agent:CoBevtAgent",
    "perception-swap:late": "learned.detector_agent:LateSharingAgent",
    "perception-swap:early": "learned.detector_agent:EarlySharingAgent",
    "perception-swap:none": "learned.detector_agent:LoneDetectorAgent",
    "codriving": "learned.codriving:CoDrivingAgent",
    "codriving:fast": "learned.codriving:FastCoDrivingAgent",
    "codriving:alone": "learned.codriving:LoneCoDrivingAgent",
    "codriving:fast-alone": "learned.codriving:FastLoneCoDrivingAgent",
}
DETECTOR_AGENTS = AgentTable(_DETECTORS)
"""Agents that see through trained detectors: the paper's rule-based planner, and the counterpart of CoDriving."""
_HUMAN = {"human": "human:HumanAgent", "human-replay": "human:HumanReplayAgent"}
HUMAN_AGENTS = AgentTable(_HUMAN)
"""The cars of people: `loop.human_driver` gives them controls. They drive nothing by themselves."""
ASKING_AGENTS = ("colmdriver",)
"""Agents that ask a language model: their answers come from outside, or from a file of a run."""
DEFENDED_AGENTS = ("sharing", "sharing+negotiation")
"""Agents whose option `defence` keeps them from believing every sender."""
AGENTS = AgentTable(
    {
        "stationary": "sensorless:StationaryAgent",
        "constant-speed": "sensorless:ConstantSpeedAgent",
        "take-turns": "sensorless:TakeTurnsAgent",
        "memory": "memory:MemoryAgent",
        "idm": "idm:IdmAgent",
        "single": "sharing:SingleAgent",
        "sharing": "sharing:SharingAgent",
        "colmdriver-rule": "colmdriver:ColmdriverRuleAgent",
        "colmdriver": "colmdriver:ColmdriverAgent",
        "sharing+negotiation": "sharing:SharingNegotiationAgent",
        **_LEARNED,
        **_DETECTORS,
        "perception-swap:attfuse:profile": "perception_swap:AttFuseProfileAgent",
        "perception-swap:disconet:profile": "perception_swap:DiscoNetProfileAgent",
        "perception-swap:fcooper:profile": "perception_swap:FCooperProfileAgent",
        "perception-swap:cobevt:profile": "perception_swap:CoBevtProfileAgent",
        "omniscient": "omniscient:OmniscientAgent",
        **_HUMAN,
    }
)
"""The names that `--agent NAME` accepts."""
