"""The rule: whoever is nearest to the conflict goes first (protocol 10.5)."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.negotiation.conflict import AFTERMATH_TICKS, Graph, graph_of, next_step
from mdrive_sumo.negotiation.intention import ridden
from mdrive_sumo.negotiation.peer_table import Roster
from mdrive_sumo.negotiation.right_of_way_claims import Claims, Terms, announcement, answers_to, claims_in, ordered
from mdrive_sumo.negotiation.types import Decision, Member, Step
from mdrive_sumo.v2x.messages import MAX_NAMES, Intention, Mcm


def winner_of(group: Sequence[str], graph: Graph, claims: Claims = frozenset()) -> str:
    """Who goes first: of those who claim it already, else of all, the nearest to its conflict, then the smallest id."""
    beaten = {second for first, second in claims if first in group}
    claimants = {first for first, second in claims if second in group and first in group} - beaten
    return min(claimants or group, key=lambda name: (graph.run_of(name), name))


def winners_intention(member: Member) -> Intention:
    """What one who goes first does: what it means to do, but it neither stops nor keeps a low speed."""
    return Intention.FASTER if member.intention == Intention.STOP else ridden(member.intention, member.speed)


def rule_actions(members: Sequence[Member], graph: Graph, group: Sequence[str]) -> dict[str, Intention]:
    """What the rule has everybody in a group do: the winner goes, all others stop."""
    winner = winner_of(group, graph)
    return {m.id: winners_intention(m) if m.id == winner else Intention.STOP for m in members if m.id in group}


class RuleNegotiator:
    """Every CAV applies the rule to its own view of the same MCMs, and says in its own MCM what it makes of it.

    Who goes first is settled once for a conflict: as long as a claim holds it is not settled anew, though the winner
    may not be the nearest any more. `passing`: the others do not stop, they line up by when they would come to where
    their ways meet, and pass one behind the other.
    `compat_ego0`: the original's slip, see protocol 10.5: the first station of all has to stop when it is in a decision
    of its own while others negotiate without it.
    """

    def __init__(self, passing: bool = False, compat_ego0: bool = False) -> None:
        self._passing, self._compat_ego0 = passing, compat_ego0
        self.roster = Roster()
        self._yields: dict[str, tuple[bool, int]] = {}
        self._decision: Decision | None = None
        self._due_tick = 0

    def step(self, tick: int, me: Member, heard: Sequence[Message]) -> Step:
        """See Negotiator."""
        for message in heard:
            self.roster.hear(message)
        if tick < self._due_tick:
            return Step(self._valid(tick))
        self._due_tick = next_step(tick)
        said = self.roster.heard(tick)
        claims = claims_in(said, tick)
        members = self.roster.members(tick)
        self._settle(tick, me.id, members, claims)
        message = announcement(me, tick, self._terms(me, tick, said, claims))
        self.roster.hear(message)
        return Step(self._valid(tick), (message,))

    def _valid(self, tick: int) -> Decision | None:
        decision = self._decision
        return decision if decision is not None and tick <= decision.until_tick else None

    def _settle(self, tick: int, me: str, members: Sequence[Member], claims: Claims) -> None:
        """Brings the decision up to date with this view."""
        graph = graph_of(members)
        group = graph.group_of(me) if me in graph.ids else ()
        if group:
            self._enter(tick, me, members, graph, claims)
        known = set(graph.ids)
        self._yields = {name: term for name, term in self._yields.items() if term[1] >= tick and name in known}
        first = frozenset(name for name, (yields, _) in self._yields.items() if yields)
        after = frozenset(self._yields) - first
        if not self._yields:
            self._decision = None
            return
        waits = Intention.SLOWER if self._passing else Intention.STOP
        mine = next(m for m in members if m.id == me)
        intention = waits if first or self._slip(me, graph, group) else winners_intention(mine)
        until = max(until for _, until in self._yields.values())
        self._decision = Decision(intention, first, after, until, group or (self._decision or _NONE).group)

    def _enter(self, tick: int, me: str, members: Sequence[Member], graph: Graph, claims: Claims) -> None:
        """Settles the group that I am in now."""
        group = graph.group_of(me)
        if self._passing:
            before = claims | leaders_among(members)
            order = ordered(group, {name: graph.entry_of(name) for name in group}, before)
            foes = graph.foes(me)
            until = {foe: tick + graph.conflict_ticks((me, foe)) + AFTERMATH_TICKS for foe in foes}
            self._yields |= {foe: (order.index(foe) < order.index(me), until[foe]) for foe in sorted(foes)}
            return
        winner = winner_of(group, graph, claims)
        until_all = tick + graph.conflict_ticks(group) + AFTERMATH_TICKS
        if winner == me:
            self._yields |= {name: (False, until_all) for name in group if name != me}
        else:
            self._yields = {winner: (True, until_all)}

    def _slip(self, me: str, graph: Graph, group: tuple[str, ...]) -> bool:
        """Whether the original would have written STOP for me by mistake."""
        if not self._compat_ego0 or me != graph.ids[0]:
            return False
        return bool(graph.conflict.any()) and not group

    def _terms(self, me: Member, tick: int, said: dict[str, Mcm], claims: Claims) -> Terms:
        decision = self._valid(tick)
        if decision is None:
            return Terms(answers=answers_to(me.id, said, claims))
        asked = Intention.SLOWER if self._passing else Intention.STOP
        over = sorted(decision.priority_over)[: MAX_NAMES - 1]
        requests = dict.fromkeys(over, asked) | {me.id: decision.intention}
        return Terms(requests, answers_to(me.id, said, claims), decision.group[:MAX_NAMES], decision.until_tick)


BESIDE_M = 1.5
SAME_WAY_COS = 0.5


def leaders_among(members: Sequence[Member]) -> Claims:
    """(leader, follower) pairs: who is on the way of another one that goes in the same direction must go first."""
    found: set[tuple[str, str]] = set()
    for follower in members:
        way = np.vstack(((follower.x, follower.y), follower.desired))
        for leader in members:
            if leader.id == follower.id or np.cos(leader.yaw - follower.yaw) < SAME_WAY_COS:
                continue
            gaps = np.hypot(way[:, 0] - leader.x, way[:, 1] - leader.y)
            ahead = np.cos(follower.yaw) * (leader.x - follower.x) + np.sin(follower.yaw) * (leader.y - follower.y)
            if ahead > 0 and gaps.min() < BESIDE_M:
                found.add((leader.id, follower.id))
    return frozenset(pair for pair in found if pair[::-1] not in found)


_NONE = Decision(Intention.KEEP)
