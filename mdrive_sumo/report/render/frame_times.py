"""Which ticks of an episode a picture or a video shows."""

from collections.abc import Iterable, Sequence
from itertools import count, pairwise, takewhile

from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scoring import Infraction, ScenarioResult


def find_telling_tick(episodes: Iterable[tuple[EpisodeRecord, ScenarioResult]]) -> int:
    """Return the tick of the first infraction that costs something, else of the first contact, else the middle."""
    every = list(episodes)
    costly = [entry[1].tick for _, result in every for entry in list_costly_infractions(result)]
    contacts = [tick for record, _ in every for tick, _ in record.contacts]
    return min(costly or contacts or [max(record.ticks for record, _ in every) // 2])


def choose_telling_cav(record: EpisodeRecord, result: ScenarioResult) -> str:
    """Return the CAV of the first infraction that costs something, else the first of the scenario."""
    costly = list_costly_infractions(result)
    return costly[0][0] if costly else record.ego_ids[0]


def list_costly_infractions(result: ScenarioResult) -> list[tuple[str, Infraction]]:
    """Return the CAVs and infractions with a factor below 1, the first first."""
    costly = [(ego.id, infraction) for ego in result.egos for infraction in ego.infractions if infraction.factor < 1.0]
    return sorted(costly, key=lambda entry: (entry[1].tick, entry[0]))


def choose_ticks(first: int, last: int, fps: int, speed: float) -> list[int]:
    """Return the tick of every frame of a video from one tick to another, both included."""
    step = speed * TICKS_PER_SECOND / fps
    return list(takewhile(lambda tick: tick <= last, (first + int(number * step) for number in count())))


def choose_durations_cs(frames: int, fps: int, hold_s: float = 0.0) -> Sequence[int]:
    """Return how long each frame of a GIF is shown, in its unit of 10 ms; the last one longer by `hold_s` [s].

    Rounding does not add up: after any number of frames the time is right to 5 ms.
    """
    ends = [round(100 * number / fps) for number in range(frames + 1)]
    durations = [end - begin for begin, end in pairwise(ends)]
    return [*durations[:-1], durations[-1] + round(100 * hold_s)]
