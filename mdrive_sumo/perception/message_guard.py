"""MessageGuard: messages of senders that contradict the own sensor, each other or themselves are not believed.

Checks lower the trust in a sender: boxes that the own free view, or that of two other senders, refutes for a second
(`free_view`, `witnesses`, `claim_history`), positions that it cannot have reached, and announcements that it does not
keep (`announced_motion`).
While no check fails, every message passes, and an agent behaves as without a guard to the digit.
"""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Message, Note, Objects, Observation, OwnState
from mdrive_sumo.contract.detector_profiles import PROFILES
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, Kind
from mdrive_sumo.perception.announced_motion import AnnouncedMotion
from mdrive_sumo.perception.claim_history import CLAIMS, ETSI_CLAIMS, Claim, ClaimHistory
from mdrive_sumo.perception.free_view import find_near, find_opaque, find_seen_through
from mdrive_sumo.perception.object_tracker import KINDS
from mdrive_sumo.perception.sender_trust import SenderTrust
from mdrive_sumo.perception.witnesses import Witness, find_refuted_by_others, make_witness
from mdrive_sumo.v2x.messages import CAM, MCM, Cam, Cpm, Denm, Mcm
from mdrive_sumo.v2x.shared_reading import decode_shared, find_shared_problem

CHECK_TICKS = 4
"""Boxes are compared with the own view every so many ticks, when the built-in agents plan and read their sensor."""
OLDEST_TICKS = TICKS_PER_SECOND // 2
"""Older positions say little about where something is now."""
MOST_SIGMA_M = 0.5
"""[m] Who states larger errors gets no more room for lies. By the project's positioning and detectors, a box 100 m
away from its sender has 0.2 m of its place, 0.35 m of its yaw, 0.26 m of the detector and 0.15 m of its speed: 0.49 m
together."""
BRAKING = 3.0
"""[m/s2] Boxes are placed by their speeds, as if none braked: firm, but no emergency."""
DISTRUST = "distrust"
"""Kind of the notes with a sender that is not believed from now on, and why."""


@dataclass(slots=True)
class _Sender:
    """What is known of one sender."""

    claims: ClaimHistory
    """What it reports of others."""
    places: ClaimHistory
    """Where it says that it is."""
    motion: AnnouncedMotion = field(default_factory=AnnouncedMotion)
    cam: Cam | None = None
    """Its newest CAM that no check has used; so for the CPM."""
    cpm: Cpm | None = None


class Contradiction(NamedTuple):
    """What a sender said that is not so."""

    sender: str
    subject: str
    """`REPORTS`: what it reports of others; `ITSELF`: its place, motion or plan."""
    reason: str


REPORTS, ITSELF = "reports", "itself"
REASONS: Mapping[str, str] = {REPORTS: "it reports what is not there", ITSELF: "it is not where it says"}


class MessageGuard:
    """The guard of one CAV."""

    def __init__(self, detector: str, v2x_rate: str = "fixed") -> None:
        """detector: profile of the own detections, which come with its latency. v2x_rate: of the episode."""
        self._claim_parameters = ETSI_CLAIMS if v2x_rate == "etsi" else CLAIMS
        self._latency_ticks = PROFILES[detector].latency_ticks
        self._trust_by_subject = {REPORTS: SenderTrust(), ITSELF: SenderTrust()}
        self._senders: dict[str, _Sender] = {}
        self._own_states: deque[tuple[int, OwnState]] = deque()
        self._distrusted: Mapping[str, frozenset[str]] = {REPORTS: frozenset(), ITSELF: frozenset()}
        """Senders that are not believed, by subject; of one that lies of itself nothing is believed."""

    def is_believed(self, sender: str) -> bool:
        """Return whether a sender is believed what it says of itself."""
        return sender not in self._distrusted[ITSELF]

    def screen(self, seen: Observation) -> tuple[Observation, frozenset[str], tuple[Note, ...]]:
        """Return the observation without messages that are not believed; senders that no longer are, and notes of them.

        Of a sender that only reported of others what is not there, messages about itself are believed: its car
        drives there all the same, and a car that did not heed its plans would block it.

        The observation itself is returned if all messages are believed. To be called in every tick.
        """
        tick = seen.tick
        self._own_states.append((tick, seen.own))
        contradictions = self._read_messages(seen)
        if tick % CHECK_TICKS == 0 and self._senders:
            contradictions += self._compare_with_view(seen)
        before = self._distrusted
        if not (contradictions or any(before.values())):
            return seen, frozenset(), ()
        for one in contradictions:
            self._trust_by_subject[one.subject].record_contradiction(one.sender, tick)
        self._distrusted = {subject: self._find_distrusted(subject, contradictions, tick) for subject in before}
        fallen = {subject: now - before[subject] for subject, now in self._distrusted.items()}
        notes = tuple(
            Note(DISTRUST, f"{one.sender}: {one.reason}") for one in contradictions if one.sender in fallen[one.subject]
        )
        believed = tuple(message for message in seen.messages if self._is_message_believed(message))
        if len(believed) < len(seen.messages):
            seen = replace(seen, messages=believed)
        return seen, fallen[REPORTS] | fallen[ITSELF], notes

    def _find_distrusted(self, subject: str, contradictions: Iterable[Contradiction], tick: int) -> frozenset[str]:
        """Return the senders that are not believed about a subject at a tick."""
        suspects = self._distrusted[subject] | {one.sender for one in contradictions if one.subject == subject}
        trust = self._trust_by_subject[subject]
        return frozenset(one for one in suspects if not trust.is_believed(one, tick))

    def _is_message_believed(self, message: Message) -> bool:
        is_about_itself = message.type in (CAM, MCM)
        return self.is_believed(message.sender) and (is_about_itself or message.sender not in self._distrusted[REPORTS])

    def _read_messages(self, seen: Observation) -> list[Contradiction]:
        """Store the messages; return the senders whose motion contradicts what they said, with the reason."""
        contradictions: dict[str, Contradiction] = {}
        for message in seen.messages:
            if message.type not in KINDS or find_shared_problem(message) is not None:
                continue
            content, sender = decode_shared(message), self._get_sender(message.sender)
            if isinstance(content, Cpm):
                sender.cpm = content
            elif isinstance(content, Cam | Mcm | Denm):
                if sender.motion.add(content):
                    reason = "it does not move as it says"
                    contradictions[message.sender] = Contradiction(message.sender, ITSELF, reason)
                if isinstance(content, Cam):
                    sender.cam = content
        return list(contradictions.values())

    def _get_sender(self, name: str) -> _Sender:
        if name not in self._senders:
            parameters = self._claim_parameters
            self._senders[name] = _Sender(ClaimHistory(parameters), ClaimHistory(parameters))
        return self._senders[name]

    def _compare_with_view(self, seen: Observation) -> list[Contradiction]:
        """Return the senders that report, and have long reported, what the own view refutes, with the reason."""
        taken_tick = seen.tick - self._latency_ticks
        while self._own_states[0][0] < taken_tick:
            self._own_states.popleft()
        if self._own_states[0][0] != taken_tick or seen.objects is None or not len(seen.objects.free_m):
            return []
        names, boxes, sigmas, witnesses = self._collect_claims(seen.tick, taken_tick)
        if not names:
            return []
        is_near = find_near(boxes, seen.objects)
        is_refuted = np.zeros(len(boxes), dtype=np.bool_)
        rows = np.flatnonzero(find_opaque(boxes) & ~is_near)
        if len(rows):
            eye, free_m = self._own_states[0][1], seen.objects.free_m
            is_refuted[rows] = find_seen_through(boxes.take(rows), sigmas[rows], eye, free_m)
            rows = rows[~is_refuted[rows]]
            senders = [names[row] for row in rows.tolist()]
            is_refuted[rows] = find_refuted_by_others(boxes.take(rows), sigmas[rows], senders, witnesses)
        return self._update_claims(seen.tick, names, boxes, is_refuted.tolist(), is_near.tolist())

    def _collect_claims(self, tick: int, taken_tick: int) -> tuple[list[str], Objects, Float, dict[str, Witness]]:
        """Return the senders of the boxes that were reported since the last check, these at the time of the own view,
        their standard deviations (N,) [m], and the believed senders that also told their view."""
        names: list[str] = []
        parts: list[Objects] = []
        sigmas: list[Float] = []
        witnesses: dict[str, Witness] = {}
        for name in sorted(self._senders):
            sender = self._senders[name]
            for content in (sender.cam, sender.cpm):
                if content is not None and 0 <= tick - content.pose.tick <= OLDEST_TICKS:
                    parts.append(_place_claims(content, taken_tick))
                    sigmas.append(_find_sigmas(content, taken_tick))
                    names += [name] * len(parts[-1])
                    if isinstance(content, Cpm) and self.is_believed(name) and name not in self._distrusted[REPORTS]:
                        witnesses[name] = make_witness(content, sender.cam, parts[-1], self._latency_ticks)
            sender.cam = sender.cpm = None
        if not parts:
            return names, Objects.empty(), np.zeros(0), witnesses
        return names, parts[0].concat(*parts[1:]), np.concatenate(sigmas), witnesses

    def _update_claims(
        self, tick: int, names: Sequence[str], boxes: Objects, is_refuted: Sequence[bool], is_near: Sequence[bool]
    ) -> list[Contradiction]:
        keys = [(name, REPORTS if boxes.ids[row] else ITSELF) for row, name in enumerate(names)]
        refuted: dict[tuple[str, str], list[Claim]] = {key: [] for key in keys}
        supported: dict[tuple[str, str], list[str]] = {key: [] for key in keys}
        for row, key in enumerate(keys):
            if is_refuted[row]:
                refuted[key].append(Claim(boxes.ids[row], float(boxes.x[row]), float(boxes.y[row])))
            elif is_near[row]:
                supported[key].append(boxes.ids[row])
        lies: list[Contradiction] = []
        for (name, subject), claims in refuted.items():
            sender = self._senders[name]
            history = sender.claims if subject == REPORTS else sender.places
            if history.update(tick, claims, supported[name, subject]):
                lies.append(Contradiction(name, subject, REASONS[subject]))
        return lies


def _place_claims(content: Cam | Cpm, tick: int) -> Objects:
    """Return the boxes of a message at a tick, by their speeds: the sender, named "", or what it detected."""
    pose = content.pose
    if isinstance(content, Cam):
        columns = [np.array([value]) for value in (pose.x, pose.y, pose.yaw, content.speed)]
        sizes = [np.array([value]) for value in (content.length, content.width)]
        kind = np.array([Kind.VEHICLE], dtype=np.uint8)
        return Objects(("",), kind, *columns, *sizes).advance((tick - pose.tick) * DT)
    ages: Float = content.age.astype(np.float64)
    return content.objects.advance((tick - pose.tick + ages) * DT)


def _find_sigmas(content: Cam | Cpm, tick: int) -> Float:
    """Return the standard deviation (N,) [m] of each coordinate of the boxes of `_place_claims`.

    They add the errors that the sender states, of its place and yaw, of its detections and of their speeds, and what
    braking changes until the tick.
    """
    pose = content.pose
    if isinstance(content, Cam):
        age_s = np.array([(tick - pose.tick) * DT])
        turn_m, spread, speed = np.zeros(1), np.zeros(1), np.array([content.speed_sigma])
    else:
        age_s = (tick - pose.tick + content.age.astype(np.float64)) * DT
        turn_m = pose.yaw_sigma * portable.hypot(content.objects.x - pose.x, content.objects.y - pose.y)
        stated = content.sigmas if len(content.sigmas) == len(content.objects) else np.zeros((len(content.objects), 3))
        spread, speed = stated[:, 0], stated[:, 2]
    moved_m = portable.hypot(speed * age_s, BRAKING / 2 * age_s * age_s)
    square = portable.square(pose.position_sigma) + turn_m * turn_m + spread * spread + moved_m * moved_m
    return np.minimum(np.sqrt(square), MOST_SIGMA_M)
