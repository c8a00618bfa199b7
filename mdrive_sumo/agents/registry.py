"""The built-in agents by name; the first docstring line of a class is the description of the agent."""

from collections.abc import Mapping
from types import MappingProxyType

from mdrive_sumo.agents.colmdriver import ColmdriverAgent
from mdrive_sumo.agents.colmdriver_rule import ColmdriverRuleAgent
from mdrive_sumo.agents.constant_speed import ConstantSpeedAgent
from mdrive_sumo.agents.idm import IdmAgent
from mdrive_sumo.agents.learned.lmdrive import LmdriveAgent
from mdrive_sumo.agents.learned.tcp import TcpAgent
from mdrive_sumo.agents.learned.uniad import UniadAgent
from mdrive_sumo.agents.learned.vad import VadAgent
from mdrive_sumo.agents.omniscient import OmniscientAgent
from mdrive_sumo.agents.perception_swap import AttFuseAgent, CoBevtAgent, DiscoNetAgent, FCooperAgent
from mdrive_sumo.agents.sharing import SharingAgent
from mdrive_sumo.agents.sharing_negotiation import SharingNegotiationAgent
from mdrive_sumo.agents.single import SingleAgent
from mdrive_sumo.agents.stationary import StationaryAgent
from mdrive_sumo.agents.take_turns import TakeTurnsAgent
from mdrive_sumo.contract.agent_options import AgentFactory

LEARNED_AGENTS: Mapping[str, AgentFactory] = MappingProxyType(
    {"tcp": TcpAgent, "lmdrive": LmdriveAgent, "uniad": UniadAgent, "vad": VadAgent}
)
"""Counterparts of the paper's systems."""
AGENTS: Mapping[str, AgentFactory] = MappingProxyType(
    {
        "stationary": StationaryAgent,
        "constant-speed": ConstantSpeedAgent,
        "take-turns": TakeTurnsAgent,
        "idm": IdmAgent,
        "single": SingleAgent,
        "sharing": SharingAgent,
        "colmdriver-rule": ColmdriverRuleAgent,
        "colmdriver": ColmdriverAgent,
        "sharing+negotiation": SharingNegotiationAgent,
        **LEARNED_AGENTS,
        "perception-swap:attfuse": AttFuseAgent,
        "perception-swap:disconet": DiscoNetAgent,
        "perception-swap:fcooper": FCooperAgent,
        "perception-swap:cobevt": CoBevtAgent,
        "omniscient": OmniscientAgent,
    }
)
"""The names that `--agent NAME` accepts."""
