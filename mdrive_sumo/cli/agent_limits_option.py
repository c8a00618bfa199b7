"""The option `--agent-limits` of the commands that run agents."""

import click

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.runs.agent_limits import LOCAL_LIMITS, OPTION, TIMES, parse_agent_limits


def _read(ctx: click.Context, param: click.Parameter, value: str | None) -> AgentLimits | None:
    """Return the limits; None without the option. Raises InputError."""
    del ctx, param
    return None if value is None else parse_agent_limits(value)


DEFAULTS = ",".join(f"{name}={getattr(LOCAL_LIMITS, f'{name}_s'):g}" for name in TIMES)

agent_limits_option = click.option(
    OPTION,
    metavar="start=S,tick=S,episode=S",
    callback=_read,
    help="Seconds that a third-party agent may take to be created, for one answer, and for all answers of an episode"
    f" [default: {DEFAULTS}].",
)
