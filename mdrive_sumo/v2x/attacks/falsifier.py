"""Falsifier: what leaves the stations of attackers instead of what their agents sent.

The attacker drives as its agent wants, and receives what it is sent. It knows the true states and the routes of all
receivers, which is more than a real one knows: what a defence withstands here, it withstands there.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from mdrive_sumo.contract import Message, Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU
from mdrive_sumo.core.seeding import draw_uniforms
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.v2x.attacks.attack_settings import AttackKind, AttackSettings
from mdrive_sumo.v2x.attacks.forged_mcm import McmForger
from mdrive_sumo.v2x.attacks.message_rewriting import read_content, rewrite
from mdrive_sumo.v2x.attacks.phantom import PhantomMaker
from mdrive_sumo.v2x.attacks.replayed_messages import ReplayedMessages
from mdrive_sumo.v2x.attacks.route_point import Receiver
from mdrive_sumo.v2x.content import Cpm, Feature, Mcm
from mdrive_sumo.v2x.messages import FLOOD, displace_message, find_problem

Told = TypeVar("Told", Cpm, Mcm, Feature)
Messages = tuple[Message, ...]
Lie = Callable[[int, Messages, Sequence[Receiver]], Messages]
"""Returns what an attacker sends in a tick instead of its agent's messages."""


class Falsifier:
    """The attackers of one episode. Deterministic: a lie depends on the attacker's id, the seed and the ticks only."""

    def __init__(self, attack: AttackSettings, name_by_attacker: Mapping[str, str], seed: int) -> None:
        """name_by_attacker: the id of each attacker in messages, by its id in `falsify`."""
        self._lie_by_attacker = {
            attacker: _make_lie(attack, name, seed) for attacker, name in sorted(name_by_attacker.items())
        }

    def falsify(
        self, tick: int, outgoing: Mapping[str, Messages], receivers: Mapping[str, Receiver], stations: Collection[str]
    ) -> dict[str, Messages]:
        """Return the messages that leave the stations in a tick; those of honest stations are unchanged.

        outgoing: by sender, what the agents sent. receivers: CAVs by id; attackers do not lie to each other.
        stations: those that can send in this tick.
        """
        sent = dict(outgoing)
        others = [receiver for name, receiver in sorted(receivers.items()) if name not in self._lie_by_attacker]
        for attacker, lie in self._lie_by_attacker.items():
            if attacker not in stations:
                continue
            messages = lie(tick, outgoing.get(attacker, ()), others)
            if messages:
                sent[attacker] = messages
            else:
                sent.pop(attacker, None)
        return sent


def _make_lie(attack: AttackSettings, name: str, seed: int) -> Lie:
    """Return the lie of one attacker, with its memory."""
    values = attack.values
    match attack.kind:
        case AttackKind.PHANTOM:
            return partial(_add_phantoms, PhantomMaker())
        case AttackKind.HIDE:
            return _hide_objects
        case AttackKind.SHIFT:
            direction = TAU * draw_uniforms(seed, "shift", name)[0]
            return partial(_shift, portable.cos_sin(direction), values["rate"], values["most"])
        case AttackKind.FORGE_MCM:
            return partial(_forge_mcms, McmForger(name, attack.claim))
        case AttackKind.REPLAY:
            return partial(_replay, ReplayedMessages(round(values["delay"] * TICKS_PER_SECOND)))
        case AttackKind.FLOOD:
            return partial(_flood, Message(FLOOD, bytes(max(1, round(values["bytes"] / TICKS_PER_SECOND)))))


def _add_phantoms(maker: PhantomMaker, _: int, messages: Messages, receivers: Sequence[Receiver]) -> Messages:
    maker.update(receivers)
    return _rewrite_all(messages, Cpm, lambda cpm: maker.add_to(cpm, receivers))


def _hide_objects(_: int, messages: Messages, __: Sequence[Receiver]) -> Messages:
    return _rewrite_all(_rewrite_all(messages, Cpm, _empty), Feature, _remove_tiles)


def _empty(cpm: Cpm) -> Cpm:
    """Return the CPM of a sender that sees nothing, as far as its sensor reaches."""
    free_m = np.full(len(cpm.objects.free_m), cpm.range_m)
    none = replace(Objects.empty(), free_m=free_m)
    return replace(cpm, objects=none, age=cpm.age[:0], sigmas=cpm.sigmas[:0])


def _remove_tiles(feature: Feature) -> Feature:
    return replace(
        feature,
        tiles=feature.tiles[:0],
        confidence=feature.confidence[:0],
        places=feature.places[:0],
        levels=feature.levels[:0],
    )


def _shift(
    direction: tuple[float, float], rate: float, most_m: float, tick: int, messages: Messages, _: Sequence[Receiver]
) -> Messages:
    shift_m = min(rate * tick * DT, most_m)
    dx, dy = shift_m * direction[0], shift_m * direction[1]
    return tuple(
        message if find_problem(message) is not None else displace_message(message, dx, dy, 0.0) for message in messages
    )


def _forge_mcms(forger: McmForger, _: int, messages: Messages, receivers: Sequence[Receiver]) -> Messages:
    return _rewrite_all(messages, Mcm, lambda mcm: forger.forge(mcm, receivers))


def _replay(replayed: ReplayedMessages, tick: int, messages: Messages, _: Sequence[Receiver]) -> Messages:
    return replayed.exchange(tick, messages)


def _flood(filler: Message, _: int, messages: Messages, __: Sequence[Receiver]) -> Messages:
    return (*messages, filler)


def _rewrite_all(messages: Messages, kind: type[Told], change: Callable[[Told], Told]) -> Messages:
    """Return the messages with the contents of one type changed."""
    contents = [read_content(message) for message in messages]
    return tuple(
        rewrite(message, change(content)) if isinstance(content, kind) else message
        for message, content in zip(messages, contents, strict=True)
    )
