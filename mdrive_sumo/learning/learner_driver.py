"""The learner that drives in rounds of DAgger: a learned agent with the weights that a round has trained."""

from pathlib import Path

from mdrive_sumo.agents.learned.system_spec import SYSTEMS, SystemSpec
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.agents.registry import LEARNED_AGENTS
from mdrive_sumo.contract import Agent
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.onnx_manifest import read_manifest
from mdrive_sumo.core.suggestion import describe_unknown


def find_driver_system(weights: Path) -> SystemSpec:
    """Return the system of weights by the manifest beside them. Raises InputError."""
    manifest = weights.with_suffix(".json")
    system = read_manifest(manifest, WeightsManifest).system
    if system not in LEARNED_AGENTS:
        raise InputError(f"{manifest}: system: {describe_unknown(system, LEARNED_AGENTS)}")
    return SYSTEMS[system]


def build_learner(weights: Path) -> tuple[Agent, SystemSpec]:
    """Return the agent of weights (ONNX, with their manifest beside them) and its system. Raises InputError.

    It runs on the processor: workers share one GPU at most, and rounds shall be repeatable.
    """
    spec = find_driver_system(weights)
    return LEARNED_AGENTS[spec.name]({"weights": str(weights), "provider": "cpu"}), spec
