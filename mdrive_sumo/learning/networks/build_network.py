"""build_network: the network of a system, by its name."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from torch import nn

from mdrive_sumo.agents.learned.system_spec import SYSTEMS, SystemSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.networks.lmdrive import LmdriveNetwork
from mdrive_sumo.learning.networks.tcp import TcpNetwork
from mdrive_sumo.learning.networks.uniad import UniadNetwork
from mdrive_sumo.learning.networks.vad import VadNetwork

NETWORKS: Mapping[str, Callable[[SystemSpec], nn.Module]] = MappingProxyType(
    {"tcp": TcpNetwork, "vad": VadNetwork, "uniad": UniadNetwork, "lmdrive": LmdriveNetwork}
)


def build_network(system: str) -> nn.Module:
    """Return the network of a system with fresh weights. Raises InputError."""
    if system not in NETWORKS:
        raise InputError(f"system {system!r}: expected one of {', '.join(NETWORKS)}, found none of that name")
    return NETWORKS[system](SYSTEMS[system])


def count_parameters(network: nn.Module) -> int:
    """Return the number of learned numbers."""
    return sum(each.numel() for each in network.parameters())
