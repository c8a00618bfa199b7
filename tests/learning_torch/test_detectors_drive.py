"""Exported detectors in agents: fresh weights drive, messages arrive, and noise of a sender breaks nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from testing.learned_samples import make_briefing

from mdrive_sumo.agents.registry import DETECTOR_AGENTS
from mdrive_sumo.contract import Message, Observation, OwnState, PointCloud, Reply, check_reply
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionNetwork
from mdrive_sumo.learning.fusion.training.export_fusion import export_fusion
from mdrive_sumo.learning.training.checkpoint import Checkpoint
from mdrive_sumo.v2x.messages import FEATURE, Feature, decode, encode
from mdrive_sumo.vehicle.control import CONTROLLERS

EAST = np.column_stack((np.arange(101.0), np.zeros(101)))


def export(detector: str, folder: Path) -> Path:
    """Write a fresh detector that answers boxes: its scores are near 1/2 instead of near 0."""
    torch.manual_seed(0)
    network = FusionNetwork(detector, is_gated=detector not in ("none", "early"))
    assert network.head.heat.bias is not None
    torch.nn.init.zeros_(network.head.heat.bias)
    summary = {"is_gated": network.gate is not None}
    return export_fusion(Checkpoint(detector, 1, 1.0, {}, network.state_dict(), {}, None, summary), folder).fusion


def shout(message: Message) -> Message:
    """The same tiles with the largest values there are, of either sign."""
    content = decode(message)
    assert isinstance(content, Feature)
    places = content.places[:200]
    levels, steps = np.where(places % 2, 255, -255), np.full(content.grid.channels, 65504.0)
    return replace(message, payload=encode(replace(content, places=places, levels=levels, steps=steps)).payload)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "is_noise"),
    [("attfuse", True), ("disconet", True), ("cobevt", True), ("fcooper", False), ("early", False), ("late", False)],
)
def test_fresh_weights_drive_and_noise_breaks_nothing(tmp_path: Path, name: str, is_noise: bool) -> None:
    weights = export("none" if name == "late" else name, tmp_path)
    agents = [DETECTOR_AGENTS[f"perception-swap:{name}"]({"weights": str(weights), "score": 0.1}) for _ in "ab"]
    for agent in agents:
        agent.start(make_briefing(EAST))
    points = np.random.default_rng(0).uniform(-40, 40, (5000, 4)).astype(np.float32)
    points[:, 2] *= 0.06
    scan = {"top": PointCloud(points, np.zeros(0, np.int32), ())}
    said: list[tuple[Message, ...]] = [(), ()]
    replies: list[Reply] = []
    for tick in range(7):
        own = [OwnState(10.0 * i, 3.0 * i, 0.3 * i, 3.0, 0.0, 0.0, 0.0) for i in range(2)]
        clouds = {} if tick % 4 else scan
        replies = [
            check_reply(
                agent.act(Observation(tick, own[i], lidar=clouds, messages=said[1 - i])), frozenset(CONTROLLERS)
            )
            for i, agent in enumerate(agents)
        ]
        said = [tuple(replace(one, sender="ab"[i], tick=tick) for one in replies[i].messages) for i in range(2)]
        if is_noise:
            said = [tuple(shout(one) if one.type == FEATURE else one for one in sent) for sent in said]
    detections = replies[0].detections
    assert detections is not None and len(detections.boxes) > 0 and np.isfinite(detections.boxes).all()
