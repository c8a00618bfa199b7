"""Quality of the reconstructed trajectories: MDrive's fidelity checks per actor, and the figures of quality.json."""

from real2sim.quality.reconstruction_quality import (
    CHECKS,
    COLLISION_SLACK_M,
    SCRIPTED_CATEGORIES,
    ReconstructedLog,
    ReconstructionQuality,
    assess_reconstruction,
)

__all__ = [
    "CHECKS",
    "COLLISION_SLACK_M",
    "SCRIPTED_CATEGORIES",
    "ReconstructedLog",
    "ReconstructionQuality",
    "assess_reconstruction",
]
