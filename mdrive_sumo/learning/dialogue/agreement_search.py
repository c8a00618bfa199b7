"""What comes of an order of passing: the drive goes on with it for some seconds, in a copy of the process.

A fork has the state of SUMO, of all agents and of the channel, so copies differ in the order alone. Each order is
simulated after the other, on the core of the drive.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.state import DT, Frame, Kind
from mdrive_sumo.learning.dialogue.situations import OrderOutcome
from mdrive_sumo.learning.dialogue.steered_agent import SteeredAgent
from mdrive_sumo.learning.drive_episode import LiveDrive
from mdrive_sumo.negotiation.agreement import build_decision
from mdrive_sumo.negotiation.conflict_graph import CONFLICT, build_conflict_graph
from mdrive_sumo.negotiation.llm_negotiator import LLM_NEGOTIATION, count_conflict_ticks
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember
from mdrive_sumo.negotiation.speaker import GroupAgreement
from mdrive_sumo.v2x.messages import Intention

HORIZON_TICKS = 160
"""8 s: an agreement holds for 5 s at most, and what it costs shows when the last member has passed."""
FREE_SPEED = 8.0
"""[m/s] Least speed that counts as driving on freely: that of the protocol."""
NEAR_S, NEAR_M = 1.5, 2.0
"""A member is about to touch a road user if their centres come so close within that time at their present velocities.
A surrogate of the time to collision of boxes; vehicles side by side in lanes are 3 m apart."""


@dataclass(frozen=True, slots=True)
class OrderTrial:
    """What is tried."""

    order: tuple[str, ...]
    """Stations."""
    members: tuple[NegotiationMember, ...]
    """Of the group, now."""


def build_order_decision(me: str, trial: OrderTrial, tick: int) -> NegotiationDecision:
    """Return what an order means for a station, as in a conversation that has agreed on it."""
    graph = build_conflict_graph(trial.members)
    ticks = count_conflict_ticks(graph, trial.order) + CONFLICT.aftermath_ticks
    until = tick + min(ticks, LLM_NEGOTIATION.max_agreement_ticks)
    agreement = GroupAgreement(dict.fromkeys(trial.order, Intention.KEEP), trial.order)
    decision = build_decision(me, trial.members, agreement, trial.order, until)
    return replace(decision, intention=Intention.SLOWER) if decision.yield_to else decision


def simulate_order(
    drive: LiveDrive, agents: Mapping[str, SteeredAgent], trial: OrderTrial, letters: Mapping[str, str]
) -> OrderOutcome | None:
    """Return how a drive goes on with an order; the drive itself stays where it is. None if the copy failed.

    agents: by CAV; letters: by station.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.close(reader)
            content = json.dumps(_drive_on(drive, agents, trial)).encode()
            os.write(writer, content)  # less than a pipe holds
            code = 0
        finally:
            os._exit(code)  # a copy must not return into the code of its parent
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        content = pipe.read()
    _, status = os.waitpid(child, 0)
    if status:
        return None
    progress, contacts, near_s = json.loads(content)
    return OrderOutcome("".join(letters[station] for station in trial.order), progress, contacts, near_s)


def _drive_on(drive: LiveDrive, agents: Mapping[str, SteeredAgent], trial: OrderTrial) -> tuple[float, int, float]:
    """Return progress, contacts and time near others of a drive with an order."""
    simulation = drive.simulation
    begin = simulation.tick
    cavs = {cav: agent for cav, agent in agents.items() if agent.station in trial.order}
    for agent in cavs.values():
        decision = build_order_decision(agent.station, trial, begin)
        agent.negotiator.steer(agent.station, trial.members, decision)
    speeds = {cav: simulation.frame.egos[cav].speed for cav in cavs}
    driven = dict.fromkeys(cavs, 0.0)
    touched: set[tuple[str, str]] = set()
    near_ticks = 0
    free = {cav: max(speed, FREE_SPEED) for cav, speed in speeds.items()}
    for _ in range(HORIZON_TICKS):
        if not simulation.is_done:
            drive.step()
        frame = simulation.frame
        present = [cav for cav in cavs if cav in frame.egos and not simulation.is_done]
        speeds |= {cav: frame.egos[cav].speed for cav in present}
        for cav, speed in speeds.items():  # one that has arrived drives on
            driven[cav] += speed * DT
        touched |= {(contact.ego, contact.other) for contact in frame.contacts if contact.ego in cavs}
        near_ticks += bool(present) and is_near(frame, present)
    shares = [driven[cav] / (free[cav] * HORIZON_TICKS * DT) for cav in cavs]
    return round(sum(shares) / len(shares), 4), len(touched), round(near_ticks * DT, 2)


def is_near(frame: Frame, cavs: Sequence[str]) -> bool:
    """Return whether one of the CAVs is about to touch a road user that moves."""
    egos, actors = list(frame.egos.values()), frame.actors
    moving = actors.kind != Kind.STATIC
    x = np.concatenate(([ego.x for ego in egos], actors.x[moving]))
    y = np.concatenate(([ego.y for ego in egos], actors.y[moving]))
    yaw = np.concatenate(([ego.yaw for ego in egos], actors.yaw[moving]))
    speed = np.concatenate(([ego.speed for ego in egos], actors.speed[moving]))
    vx, vy = speed * portable.cos(yaw), speed * portable.sin(yaw)
    names = list(frame.egos)
    for cav in cavs:
        row = names.index(cav)
        dx, dy, du, dv = x - x[row], y - y[row], vx - vx[row], vy - vy[row]
        square = du * du + dv * dv
        when = np.clip(-(dx * du + dy * dv) / np.maximum(square, 1e-9), 0.0, NEAR_S)
        gaps = portable.hypot(dx + when * du, dy + when * dv)
        gaps[row] = np.inf
        if float(gaps.min()) < NEAR_M and float(speed[row]) > FREE_SPEED / 16:
            return True
    return False
