"""Dense corridors of the hard tier: signals, buses, cyclists and pedestrians."""

CORRIDOR_NETWORKS = "hard_corridor_"
"""Beginning of the names of their networks."""


def is_corridor_network(network: str) -> bool:
    """Return whether a network is a dense corridor."""
    return network.startswith(CORRIDOR_NETWORKS)
