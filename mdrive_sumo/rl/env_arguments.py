"""EnvArguments: the keyword arguments of every environment."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, cast

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.episode.episode_options import EpisodeArguments, EpisodeOptions
from mdrive_sumo.rl.env_settings import EnvSettings


class EnvArguments(EpisodeArguments, total=False):
    """The fields of `EnvSettings`, and conditions of the episodes as for `md.simulate`."""

    suite: str
    scenarios: Sequence[str]
    density: Sequence[int]
    curriculum: Sequence[Mapping[str, Any]]
    view: str
    grid: str
    control: str
    nearest: int
    message_bytes: int
    senders: int
    ticks_per_decision: int
    others: str
    learner: int
    vary: bool


def read_settings(arguments: EnvArguments) -> EnvSettings:
    """Return the settings. Raises InputError for an argument that does not exist, or a value that it cannot have."""
    given = dict(cast("Mapping[str, Any]", arguments))
    own = {one.name for one in fields(EnvSettings)} - {"options"}
    episode = set(EpisodeArguments.__annotations__) - {"agent_clock"}  # the caller replies in the tick it was asked
    for name in given:
        if name not in own | episode:
            raise InputError(f"environment: argument: {describe_unknown(name, sorted(own | episode))}")
    options = {name: given.pop(name) for name in tuple(given) if name in episode}
    EpisodeOptions.parse(**options)  # said now, and not in the process of the environment
    settings = EnvSettings(**given, options=options)
    settings.check_scenarios()  # likewise
    return settings
