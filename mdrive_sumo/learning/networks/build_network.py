"""build_network: the network of a system, by its name."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from torch import nn

from mdrive_sumo.agents.learned.system_spec import PLAN_HEADS, SYSTEMS, SystemSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.networks.lmdrive import LmdriveNetwork
from mdrive_sumo.learning.networks.tcp import TcpNetwork
from mdrive_sumo.learning.networks.uniad import UniadNetwork
from mdrive_sumo.learning.networks.vad import VadNetwork

NETWORKS: Mapping[str, Callable[[SystemSpec, str], nn.Module]] = MappingProxyType(
    {"tcp": TcpNetwork, "vad": VadNetwork, "uniad": UniadNetwork, "lmdrive": LmdriveNetwork}
)


def build_network(system: str, plan_head: str = PLAN_HEADS[0]) -> nn.Module:
    """Return the network of a system with fresh weights and a head of `PLAN_HEADS`. Raises InputError."""
    if system not in NETWORKS:
        raise InputError(f"system {system!r}: expected one of {', '.join(NETWORKS)}, found none of that name")
    return NETWORKS[system](SYSTEMS[system], plan_head)


def count_parameters(network: nn.Module) -> int:
    """Return the number of learned numbers."""
    return sum(each.numel() for each in network.parameters())
