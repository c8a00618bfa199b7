"""Replay: a station's messages of some time ago, sent once more as if they were new."""

from collections import deque
from dataclasses import replace

from mdrive_sumo.contract import Message
from mdrive_sumo.v2x.attacks.message_rewriting import read_content, rewrite
from mdrive_sumo.v2x.content import Denm, Mcm


class ReplayedMessages:
    """The messages of one attacker, delayed. Until the delay has passed, its messages go out as they are."""

    def __init__(self, delay_ticks: int) -> None:
        self._delay_ticks = delay_ticks
        self._stored: deque[tuple[int, tuple[Message, ...]]] = deque()

    def exchange(self, tick: int, messages: tuple[Message, ...]) -> tuple[Message, ...]:
        """Store the messages of a tick; return those to send: of `delay_ticks` ago, with the present time in them."""
        self._stored.append((tick, messages))
        if tick < self._delay_ticks:
            return messages
        due: tuple[Message, ...] = ()
        while self._stored and self._stored[0][0] <= tick - self._delay_ticks:
            sent_tick, due = self._stored.popleft()
            if sent_tick < tick - self._delay_ticks:
                due = ()
        return tuple(restamp(message, self._delay_ticks) for message in due)


def restamp(message: Message, ticks: int) -> Message:
    """Return the message with all its times so many ticks later; the same if it has none, or no valid content."""
    content = read_content(message)
    if content is None:
        return message
    later = replace(content, pose=replace(content.pose, tick=content.pose.tick + ticks))
    if isinstance(later, Mcm):
        later = replace(later, until_tick=later.until_tick + ticks)
    if isinstance(later, Denm):
        later = replace(later, detection_tick=later.detection_tick + ticks)
    return rewrite(message, later)
