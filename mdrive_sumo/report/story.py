"""The story of one CAV in sentences: what it did, as the recording shows it, and why, as its agent noted it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.clean_text import truncate
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, End, FailureReason
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.report.drivers import NotedDriver, describe_change, find_driver, list_drivers
from mdrive_sumo.report.negotiation_story import MAX_TEXT, tell_negotiation
from mdrive_sumo.report.reasons import MIN_DISTANCE_M, NotedReason, list_reasons, name_road_user
from mdrive_sumo.report.run_page.losses import list_losses
from mdrive_sumo.report.speed_changes import (
    STANDING_SPEED,
    cut_standing,
    keep_long,
    list_brakings,
    list_runs,
)
from mdrive_sumo.scoring import EgoResult, ScenarioResult
from mdrive_sumo.v2x.messages import (
    DENM,
    Denm,
    EventCause,
    decode,
    find_problem,
)

NEARLY_STANDING = 0.5
"""[m/s] Below this speed a car that goes on has almost stopped."""
MIN_STAND_TICKS = TICKS_PER_SECOND // 2
"""A shorter stop is the end of braking, not a wait."""
MIN_BRAKING = 1.5
"""[m/s] A smaller loss of speed in one go is not worth a sentence: a gap or a bend."""
NOTED_BEFORE_TICKS = TICKS_PER_SECOND
"""A reason noted this long before the speed falls is that of the braking: a plan takes about a second to show."""
CONTACT_LOSS = 0.8
"""[m/s] A speed that falls by more in one tick, with 16 m/s2, does so by contact: no tyre brakes like that."""
MIN_HOLD_TICKS = TICKS_PER_SECOND
"""A reason that limits a driving car for a shorter time leaves no trace in its speed."""
MAX_REASONS = 3
"""Reasons in one sentence; it counts the rest."""
AHEAD_OF_CAV_M, BESIDE_CAV_M = 25.0, 2.0
"""[m] Where no reasons were noted, the nearest road user in this rectangle before the CAV is named: about the distance
in which a car at 8 m/s stops gently, and a lane's half width."""
ENDINGS = {
    End.ARRIVED: "arrives",
    End.BLOCKED: "counts as blocked: it has not moved for too long",
    End.DEVIATED: "has left its route",
    End.TIMED_OUT: "runs out of time",
    End.AGENT_FAILED: "is out: its agent failed",
}
LEFT = "is out: the person who drove has left"
EVENT_WORDS = {
    EventCause.STATIONARY_VEHICLE: "itself, because it stands",
    EventCause.COLLISION_RISK: "a collision that it expects",
    EventCause.DANGEROUS_SITUATION: "its emergency braking",
}


@dataclass(frozen=True, slots=True)
class Span:
    """What a CAV does from one tick to another one, both included."""

    first: int
    last: int
    kind: str
    """stands, brakes, drives, or is pushed: it loses speed by contact."""


@dataclass(frozen=True, slots=True)
class StoryLine:
    """One sentence without its subject, which is the CAV."""

    tick: int
    text: str

    def format(self) -> str:
        """Return the sentence after its time."""
        return f"{self.tick * DT:6.1f} s  {self.text}"


@dataclass(frozen=True)
class CavStory:
    """What one CAV of an episode did and why."""

    episode: EpisodeRecord
    ego: str
    result: ScenarioResult
    route_m: float
    """Length of its route [m]."""

    @property
    def _column(self) -> int:
        return self.episode.ego_ids.index(self.ego)

    @property
    def last_tick(self) -> int:
        """The last tick in which the CAV is in the world."""
        return int(np.flatnonzero(self.episode.valid[:, self._column])[-1])

    @property
    def _score(self) -> EgoResult:
        return next(ego for ego in self.result.egos if ego.id == self.ego)

    @cached_property
    def drivers(self) -> list[NotedDriver]:
        """Who drives it, in a take: people and agents in turn."""
        return list_drivers(self.episode, self.ego)

    @cached_property
    def reasons(self) -> list[NotedReason]:
        """The reasons that its agents noted."""
        return [reason for reason in list_reasons(self.episode) if reason.ego == self.ego]

    def tell(self) -> list[str]:
        """Return the whole story, line by line."""
        return [*self._describe_run(), *(line.format() for line in self._list_lines())]

    def tell_moment(self, tick: int) -> list[str]:
        """Return what holds in a tick, and since when."""
        now = f"At tick {tick} ({tick * DT:.1f} s) CAV {self.ego}"
        if tick > self.last_tick:
            ending = self.episode.find_ending(self.ego)
            return [f"{now} is not in the world any more: at {ending.tick * DT:.1f} s it {_name_ending(ending)}."]
        span = next(span for span in self._list_spans() if span.first <= tick <= span.last)
        speed = abs(float(self.episode.speed[tick, self._column]))
        pace = "" if span.kind == "stands" else f" at {speed:.1f} m/s"
        lines = [f"{now} {span.kind}{pace}, since {span.first * DT:.1f} s (tick {span.first})."]
        driver = self._find_driver(tick)
        if driver is not None:
            lines.append(f"It is driven by {driver.name}, since {driver.tick * DT:.1f} s (tick {driver.tick}).")
        if driver is None or not driver.is_person:
            lines += self._explain_moment(span, tick) or ["Its agent has noted no reason."]
        if ahead := self._describe_ahead(tick):
            lines.append(f"Ahead of it: {ahead}.")
        return lines

    def _explain_moment(self, span: Span, tick: int) -> list[str]:
        """Return the reason of a span as far as it is noted at a tick, and the last one if that is another."""
        noted = [reason for reason in self._list_valid(tick) if reason.tick <= tick]
        if not noted:
            return []
        last = noted[-1]
        why = self._select_telling(replace(span, last=tick))[-1] if span.kind in ("brakes", "stands") else last
        word = "Its agent sees no reason" if why.drives_on and span.kind != "drives" else "Why"
        lines = [f"{word}, noted at {why.tick * DT:.1f} s (tick {why.tick}): it {why.text}."]
        if why != last:
            lines.append(f"Noted later, at {last.tick * DT:.1f} s (tick {last.tick}): it {last.text}.")
        return lines

    def _describe_run(self) -> list[str]:
        score, about = self._score, self.episode.about
        head = f"CAV {self.ego} of {self.episode.scenario} (agent {about.get('agent', '?')}, seed {self.result.seed})"
        told = f"{head}: {score.outcome}, DS {score.ds:.1f}, RC {score.rc:.1f} %."
        if self.reasons or self.drivers:
            return [told]
        return [told, "Its agent noted no reasons, so this is only what the recording shows."]

    def _list_lines(self) -> list[StoryLine]:
        told = self._tell_losses(), self._tell_motion(), self._tell_negotiation(), self._tell_warnings()
        lines = [*self._tell_drivers(), *(line for lines in told for line in lines), self._tell_ending()]
        return sorted(lines, key=lambda line: line.tick)

    def _tell_drivers(self) -> Iterator[StoryLine]:
        """Yield who drives, whenever that changes."""
        for before, driver in zip((None, *self.drivers), self.drivers, strict=False):
            yield StoryLine(driver.tick, describe_change(before, driver))

    def _list_valid(self, tick: int) -> list[NotedReason]:
        """Return the reasons that the driver of a tick noted: those of another driver say nothing about it."""
        if not self.drivers:
            return self.reasons
        begins = [driver.tick for driver in self.drivers]
        first = max((begin for begin in begins if begin <= tick), default=0)
        end = min((begin for begin in begins if begin > tick), default=self.episode.ticks)
        return [reason for reason in self.reasons if first <= reason.tick < end]

    def _list_spans(self) -> list[Span]:
        """Return the spans of standing, braking and driving, which cover all ticks of the CAV."""
        speed = np.abs(self.episode.speed[: self.last_tick + 1, self._column])
        stands = keep_long(speed < STANDING_SPEED, MIN_STAND_TICKS)
        spans = [Span(first, last, "stands") for first, last in list_runs(stands)]
        for first, last in list_brakings(speed):
            first, last = cut_standing(first, last, stands)
            contact = first + int(np.argmax(np.append(np.diff(speed[first : last + 1]) < -CONTACT_LOSS, True)))
            if speed[first] - speed[contact] >= MIN_BRAKING:
                spans.append(Span(first, contact - (contact < last), "brakes"))
            if contact < last:
                spans.append(Span(contact, last, "is pushed"))
        covered = np.zeros(len(speed), dtype=np.bool_)
        for span in spans:
            covered[span.first : span.last + 1] = True
        spans += [Span(first, last, "drives") for first, last in list_runs(~covered)]
        return sorted(spans, key=lambda span: span.first)

    def _tell_motion(self) -> Iterator[StoryLine]:
        """Yield what it does: departures, braking, standing; driving on between two of them follows by itself."""
        speed = np.abs(self.episode.speed[:, self._column])
        spans = self._list_spans()
        for i, span in enumerate(spans):
            before, after = (spans[i - 1] if i else None), (spans[i + 1] if i + 1 < len(spans) else None)
            if span.kind == "brakes":
                low = float(speed[span.last])
                stops = after is not None and after.kind == "stands"
                goal = "to a stop" if stops else "almost to a stop" if low < NEARLY_STANDING else f"to {low:.1f} m/s"
                what = self._name_doer(span) + f"brakes from {float(speed[span.first]):.1f} m/s {goal}"
                yield StoryLine(span.first, what + self._explain(span))
            elif span.kind == "is pushed":
                low, high = float(speed[span.last]), float(speed[span.first])
                yield StoryLine(span.first + 1, f"loses speed by contact: from {high:.1f} m/s to {low:.1f} m/s")
            elif span.kind == "stands" and (after is not None or span.first > 0):
                until = (span.last + 1) * DT
                what = f"stands until {until:.1f} s ({(span.last + 1 - span.first) * DT:.1f} s)"
                if before is not None or span.last - span.first > 2 * TICKS_PER_SECOND:
                    yield StoryLine(span.first, what + self._explain(span))
            elif span.kind == "stands":
                yield StoryLine(span.first, "stands all the time" + self._explain(span))
            elif before is None or before.kind == "stands":
                what = self._name_doer(span) + ("departs" if i < 2 else "drives on")
                yield StoryLine(span.first, what + self._explain_departure(span))
            if span.kind == "drives":
                yield from self._tell_holding_back(span)

    def _find_driver(self, tick: int) -> NotedDriver | None:
        """Return who drives in a tick; None where that is not known, or not any more."""
        failed = self.episode.find_ending(self.ego).failed_tick
        return None if failed is not None and tick >= failed else find_driver(self.drivers, tick)

    def _name_doer(self, span: Span) -> str:
        """Return the subject of a sentence where a person drives; else it is the CAV."""
        driver = self._find_driver(span.first)
        return "the person " if driver is not None and driver.is_person else ""

    def _explain(self, span: Span) -> str:
        """Return the reasons that hold in a span, or without any what is ahead of the car."""
        if not self._list_valid(span.first):
            ahead = self._describe_ahead(span.first) or self._describe_ahead(span.last)
            return f", with {ahead}" if ahead else ""
        telling = self._select_telling(span)
        if telling and all(reason.drives_on for reason in telling):
            when = _tell_since(telling[-1], span.first)
            return f", although its agent notes {when}that it {telling[-1].text}"
        first_of: dict[object, NotedReason] = {}
        for reason in telling:
            first_of.setdefault(reason.key, reason)
        told = list(first_of.values())
        parts = [_tell_since(reason, span.first) + reason.text for reason in told[:MAX_REASONS]]
        more = len(told) - MAX_REASONS
        if not parts:
            return ""
        return f": {'; '.join(parts)}" + (f"; and {more} more reasons" if more > 0 else "")

    def _select_telling(self, span: Span) -> list[NotedReason]:
        """Return the reasons of braking or standing: those that limit the car if there are any, else all that hold."""
        before_ticks = NOTED_BEFORE_TICKS if span.kind == "brakes" else 0
        held = _select_reasons(self._list_valid(span.first), span.first - before_ticks, span.last)
        return [reason for reason in held if reason.limits] or held

    def _tell_holding_back(self, span: Span) -> Iterator[StoryLine]:
        """Yield what keeps a car slow that neither brakes nor stands."""
        reasons = self.reasons
        ends = [following.tick for following in reasons[1:]] + [span.last] * bool(reasons)
        for reason, end in zip(reasons, ends, strict=True):
            until = min(end, span.last, *(driver.tick for driver in self.drivers if driver.tick > reason.tick))
            if span.first <= reason.tick and reason.limits and until - reason.tick >= MIN_HOLD_TICKS:
                yield StoryLine(reason.tick, f"holds back: {reason.text}")

    def _explain_departure(self, span: Span) -> str:
        held = [reason for reason in self._list_valid(span.first) if reason.tick <= span.first + MIN_STAND_TICKS]
        if not held or held[-1].limits:
            return ""
        return f": {_tell_since(held[-1], span.first)}{held[-1].text}"

    def _describe_ahead(self, tick: int) -> str:
        """Return the nearest road user in the lane ahead in words; "" if there is none."""
        episode, own = self.episode, self._column
        cos, sin = portable.cos_sin(float(episode.yaw[tick, own]))
        dx, dy = episode.x[tick] - episode.x[tick, own], episode.y[tick] - episode.y[tick, own]
        along, beside = cos * dx + sin * dy, np.abs(cos * dy - sin * dx)
        gap_m = np.where(
            episode.valid[tick] & (along > 0) & (beside < BESIDE_CAV_M),
            along - (episode.length + episode.length[own]) / 2,
            np.inf,
        )
        gap_m[own] = np.inf
        nearest = int(gap_m.argmin())
        if gap_m[nearest] > AHEAD_OF_CAV_M:
            return ""
        speed = abs(float(episode.speed[tick, nearest]))
        name, gap = name_road_user(episode, episode.ids[nearest]), float(gap_m[nearest])
        where = "close ahead" if gap < MIN_DISTANCE_M else f"{gap:.1f} m ahead"
        return f"{name} {where}, {'standing' if speed < STANDING_SPEED else f'at {speed:.1f} m/s'}"

    def _tell_losses(self) -> Iterator[StoryLine]:
        """Yield infractions, and collisions that others ran into."""
        cavs = set(self.episode.ego_ids)
        for loss in list_losses(self._score, cavs, self.route_m):
            if loss.kind not in ("blocked", "route-deviation", "timed-out", "agent-failed", "time"):
                yield StoryLine(loss.tick, f"infraction: {loss.text}")

    def _tell_negotiation(self) -> Iterator[StoryLine]:
        """Yield what it asked, answered and said, whenever that changed."""
        for tick, text in tell_negotiation(self.episode, self.ego):
            yield StoryLine(tick, text)

    def _tell_warnings(self) -> Iterator[StoryLine]:
        """Yield what it warned others of, once for each event."""
        told: set[int] = set()
        for sent in self.episode.messages:
            message = sent.message
            if message.sender != self.ego or message.type != DENM or find_problem(message) is not None:
                continue
            denm = decode(message)
            assert isinstance(denm, Denm), "expected a DENM"
            if denm.sequence not in told:
                told.add(denm.sequence)
                yield StoryLine(message.tick, f"warns of {EVENT_WORDS[denm.cause]}")

    def _tell_ending(self) -> StoryLine:
        ending = self.episode.find_ending(self.ego)
        text = truncate(" ".join(ending.text.split()), MAX_TEXT)
        if ending.failure is FailureReason.LEFT:
            return StoryLine(ending.tick, f"is out: {text}")
        return StoryLine(ending.tick, ENDINGS[ending.end] + (f" ({text})" if text else ""))


def _name_ending(ending: Ending) -> str:
    """Return how a CAV ends in words."""
    return LEFT if ending.failure is FailureReason.LEFT else ENDINGS[ending.end]


def _tell_since(reason: NotedReason, begin_tick: int) -> str:
    """Return when a reason was noted, "" if about at `begin_tick`: its distances and times are of that moment."""
    if reason.tick < begin_tick - NOTED_BEFORE_TICKS:
        return f"since {reason.tick * DT:.1f} s "
    return "" if reason.tick <= begin_tick + MIN_STAND_TICKS else f"from {reason.tick * DT:.1f} s "


def _select_reasons(reasons: Sequence[NotedReason], first: int, last: int) -> list[NotedReason]:
    """Return the reason that holds at tick `first`, and those noted up to tick `last`."""
    before = [reason for reason in reasons if reason.tick <= first]
    return before[-1:] + [reason for reason in reasons if first < reason.tick <= last]
