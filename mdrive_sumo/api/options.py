"""Options of the front door, as text or as typed values."""

from mdrive_sumo.actors import ActorMode
from mdrive_sumo.core.clock import Clock, parse_clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop import EpisodeOptions
from mdrive_sumo.scenario.weather import FrictionMode
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings


def make_options(comm: str | CommSettings, agent_clock: str | Clock, actors: str, friction: str) -> EpisodeOptions:
    """Return the options of an episode. Each text means what the option of `mdrive-sumo eval` means.

    Raises InputError for an unknown value.
    """
    if isinstance(comm, str):
        if comm not in PRESETS:
            raise InputError(f"comm: expected one of {', '.join(PRESETS)}, found {comm!r:.40}")
        comm = PRESETS[comm]
    clock = parse_clock(agent_clock) if isinstance(agent_clock, str) else agent_clock
    try:
        return EpisodeOptions(comm, clock, ActorMode(actors), FrictionMode(friction))
    except ValueError as error:
        modes, frictions = ", ".join(ActorMode), ", ".join(FrictionMode)
        raise InputError(f"actors, friction: expected one of {modes}, and one of {frictions}: {error}") from None
