"""Options that permit the agent of a stored run to be executed again."""

import sys
from collections.abc import Callable
from typing import Any

import click

from mdrive_sumo.api.verification import Permission
from mdrive_sumo.cli.setting_options import add_options, setting_option


def foreign_agent_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add `--trust-agent`, `--sandbox` and `--agent` to a command that executes a stored run."""
    return add_options(
        [
            click.option(
                "--trust-agent", is_flag=True, help="Run the agent's file that RUN names with your permissions."
            ),
            click.option(
                "--sandbox", is_flag=True, help="Run it in boxes, as a run made with `eval --sandbox` always is."
            ),
            click.option("--agent", metavar="PATH:CLASS", help="Where the run's agent is now, if it has moved."),
            setting_option("agent_limits"),
        ]
    )(function)


def read_permission(options: dict[str, Any]) -> Permission:
    """Take the options out of a command's and return them. On a terminal the user is asked if none permits it."""
    ask = click.confirm if sys.stdin.isatty() else None
    trusted, sandbox, place = (options.pop(name) for name in ("trust_agent", "sandbox", "agent"))
    return Permission(trusted, sandbox, place, ask, options.pop("agent_limits"))
