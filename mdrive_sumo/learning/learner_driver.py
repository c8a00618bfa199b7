"""The learner that drives in rounds of DAgger: a learned agent with the weights that a round has trained."""

from pathlib import Path

from mdrive_sumo.agents.learned.system_spec import SystemSpec
from mdrive_sumo.contract import Agent


def build_learner(weights: Path) -> tuple[Agent, SystemSpec]:
    """Return the agent of weights (ONNX, with their manifest beside them) and its system. Raises InputError."""
    raise NotImplementedError(weights)
