"""The drivers of a take in words: who drove a CAV in which ticks, as the notes of its recording say."""

from collections.abc import Sequence
from dataclasses import dataclass

from mdrive_sumo.contract import DRIVER
from mdrive_sumo.contract.human_options import HUMAN, HUMAN_REPLAY
from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord, NoteRecord
from mdrive_sumo.loop.human_actions import RECORDING, DriverChoice

TAKES = (HUMAN, HUMAN_REPLAY)
"""Agents of recordings whose driver notes count: any other agent may write what it likes."""


@dataclass(frozen=True, slots=True)
class NotedDriver:
    """Who drives a CAV from a tick on."""

    tick: int
    choice: DriverChoice
    is_repeated: bool = False
    """Whether it is the drive of a take that an agent repeats."""

    @property
    def is_person(self) -> bool:
        """Whether it is a person."""
        return self.choice.name == HUMAN

    @property
    def name(self) -> str:
        """The driver in a sentence."""
        if self.choice.name == RECORDING:
            return "a recording"
        device = f" ({self.choice.device})" if self.choice.device != "unknown" else ""
        person = f"the person of a take{device}" if self.is_repeated else f"a person{device}"
        return person if self.is_person else self.choice.name


def read_driver(episode: EpisodeRecord, record: NoteRecord) -> NotedDriver | None:
    """Return the driver of a note; None for a damaged one, and in a recording that is no take."""
    if (agent := episode.about.get("agent")) not in TAKES:
        return None
    try:
        return NotedDriver(record.tick, DriverChoice.from_note(record.note), agent != HUMAN)
    except InputError:
        return None


def list_drivers(episode: EpisodeRecord, ego: str) -> list[NotedDriver]:
    """Return who drives a CAV, in order; nothing for a recording that is no take."""
    noted = [read_driver(episode, one) for one in episode.notes if one.ego == ego and one.note.kind == DRIVER]
    return sorted((one for one in noted if one is not None), key=lambda one: one.tick)


def find_driver(drivers: Sequence[NotedDriver], tick: int) -> NotedDriver | None:
    """Return who drives in a tick, of `list_drivers`; None if that is not known."""
    return next((driver for driver in reversed(drivers) if driver.tick <= tick), None)


def describe_change(before: NotedDriver | None, now: NotedDriver) -> str:
    """Return a change of the driver in words, without its subject, which is the CAV."""
    name = clean_line(now.name)[:100]
    if before is None:
        return f"is driven by {name}"
    if before.is_person:
        return f"is handed over by the person to {name}"
    return f"is taken over by {name} from {clean_line(before.name)[:100]}"
