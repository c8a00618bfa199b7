"""What the CAVs of the recorded crossing say to each other, made by hand, for tests of the viewer's layers."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Message, Note, Objects
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.episode import EpisodeRecord, NoteRecord
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage
from mdrive_sumo.v2x.messages import (
    Cam,
    Content,
    Cpm,
    Direction,
    Intention,
    Mcm,
    ReferencePose,
    encode,
    format_track_name,
)
from testing.viewer_crossing import record, scenario

RSU = "rsu_1"
LOST_EVERY = 7
"""Every seventh message to a CAV is lost."""


def with_rsu(egos: int) -> Scenario:
    """The scenario of the crossing with a road-side unit at its corner."""
    return scenario(egos).model_copy(update={"rsus": (RoadsideUnit(id=RSU, x=14.0, y=14.0),)})


def talking(
    ticks: int = 40, egos: int = 2, actors: int = 3, text: str = "I wait for you.", latency: int = 2
) -> EpisodeRecord:
    """`record` with CAM at 20 Hz, CPM and MCM at 10 Hz, text once a second, notes, and a road-side unit's CPM."""
    episode = record(ticks, egos, actors)
    messages = [(sender, tick, content) for tick in range(ticks) for sender, content in _said(episode, tick, text)]
    sent = tuple(_sent(episode, n, *message, latency) for n, message in enumerate(messages))
    exchange = {"request": {"messages": [{"role": "user", "content": f"Speak: {text}"}]}, "answer": text}
    notes = (
        NoteRecord(5, "cav_0", Note("llm-exchange", json.dumps(exchange))),
        NoteRecord(12, "cav_1", Note("llm-fallback", text)),
        NoteRecord(15, "cav_0", Note("negotiation", json.dumps({"round": 1, "feedback": text}))),
    )
    return replace(episode, messages=sent, notes=notes)


def _said(episode: EpisodeRecord, tick: int, text: str) -> Iterator[tuple[str, Content]]:
    for i, ego in enumerate(episode.ego_ids):
        if not episode.valid[tick, i]:
            continue
        pose = pose_of(episode, i, tick)
        yield ego, Cam(pose, float(episode.speed[tick, i]), 0.5, 0.01, 4.7, 1.9)
        if tick % 2 == 0:
            yield ego, _cpm(episode, i, pose)
            yield ego, _mcm(episode, i, pose)
        if tick % 20 == 5 * i:
            yield ego, f"[00c0ffee {tick // 60 + 1}] {text}"
    if tick % 2 == 0:
        yield RSU, replace(_cpm(episode, -1, ReferencePose(14.0, 14.0, 0.0, tick)), roadside=True)


def pose_of(episode: EpisodeRecord, i: int, tick: int) -> ReferencePose:
    """Where road user i is."""
    return ReferencePose(float(episode.x[tick, i]), float(episode.y[tick, i]), float(episode.yaw[tick, i]), tick)


def _cpm(episode: EpisodeRecord, observer: int, pose: ReferencePose) -> Cpm:
    """All others within 40 m, as restless as measured objects are."""
    tick = pose.tick
    noise = np.random.default_rng((tick, observer + 1)).normal(0, 0.2, (4, len(episode.ids)))
    x, y, yaw, speed = noise + np.stack((episode.x, episode.y, episode.yaw, episode.speed))[:, tick]
    away = np.hypot(episode.x[tick] - pose.x, episode.y[tick] - pose.y)
    near = np.flatnonzero(episode.valid[tick] & (away < 40) & (np.arange(len(away)) != observer))
    objects = Objects(
        tuple(format_track_name(1000 * (observer + 1) + i) for i in near.tolist()), episode.kind[near],
        x[near], y[near], yaw[near], speed[near],
        episode.length[near], episode.width[near],
    )  # fmt: skip
    return Cpm(pose, 40.0, objects, np.zeros(len(near), dtype=np.uint8))


def _mcm(episode: EpisodeRecord, i: int, pose: ReferencePose) -> Mcm:
    ahead = _straight(pose, 0.8)
    near_middle = math.hypot(pose.x, pose.y) < 80
    group = tuple(sorted(episode.ego_ids)) if near_middle else ()
    first = i == 0
    return Mcm(
        pose, float(episode.speed[pose.tick, i]), Intention.KEEP if first else Intention.SLOWER,
        Direction.FOLLOW if first else Direction.LEFT, 0.2, ahead, _straight(pose, 1.4),
        {"cav_1": Intention.STOP} if first and group else {}, {"cav_0": True} if group else {},
        group[::-1] if first else group, pose.tick + 40,
    )  # fmt: skip


def _straight(pose: ReferencePose, step_m: float) -> Float:
    steps: Float = np.arange(1.0, 26.0) * step_m
    return np.array((pose.x, pose.y)) + steps[:, None] * np.array((math.cos(pose.yaw), math.sin(pose.yaw)))


def _sent(episode: EpisodeRecord, n: int, sender: str, tick: int, content: Content, latency: int) -> SentMessage:
    message = encode(content)
    receivers = [ego for i, ego in enumerate(episode.ego_ids) if ego != sender and episode.valid[tick, i]]
    fates = {
        receiver: (DeliveryStatus.LOST if (n + k) % LOST_EVERY == 0 else DeliveryStatus.DELIVERED, tick + latency)
        for k, receiver in enumerate(receivers)
    }
    return SentMessage(Message(message.type, message.payload, sender, tick), fates)
