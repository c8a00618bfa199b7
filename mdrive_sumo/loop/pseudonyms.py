"""Pseudonyms: the ids by which agents know CAVs and road-side units, like the station ids of ETSI ITS.

A scenario numbers its CAVs. An agent that learned its number could take turns by it without any negotiation, so the
border to agents replaces the scenario's ids. Results and recordings keep them.
"""

from collections.abc import Iterable, Mapping

from mdrive_sumo.contract import Message
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.episode.episode_options import StationIds


def derive_pseudonyms(stations: Iterable[str], ids: StationIds, run_seed: int, scenario: str) -> dict[str, str]:
    """Return the id that agents get for every station of a scenario: 8 hexadecimal digits, unique in the episode.

    The ids depend on run seed, scenario and station only. With `StationIds.SCENARIO` they are the scenario's.
    """
    pseudonyms: dict[str, str] = {}
    for station in stations:
        attempt = 0
        while (name := _derive_name(ids, run_seed, scenario, station, attempt)) in pseudonyms.values():
            attempt += 1
        pseudonyms[station] = name
    return pseudonyms


def _derive_name(ids: StationIds, run_seed: int, scenario: str, station: str, attempt: int) -> str:
    if ids is StationIds.SCENARIO:
        return station
    return f"{derive_seed(run_seed, scenario, 'pseudonym', station, str(attempt)):08x}"


def rename_senders(messages: Iterable[Message], pseudonyms: Mapping[str, str]) -> tuple[Message, ...]:
    """Return the messages that arrive in one tick under the senders' pseudonyms.

    They are sorted by tick of sending and pseudonym, because the order of the scenario's ids would tell them.
    """
    renamed = [build_frozen(Message, one.type, one.payload, pseudonyms[one.sender], one.tick) for one in messages]
    return tuple(sorted(renamed, key=lambda message: (message.tick, message.sender)))
