"""Drive a sample of the episodes behind the published rows, and compare it with what was driven for them.

    python -m tools.sample_episodes [AGENT...] [--write]

`docs/results/episodes.json` has a few short episodes of every row of `docs/results/baselines.json`, each with its
driving score and digest: those at the commit that the row names. A test drives them. Where one differs, the agent
drives otherwise than its row says: mend it, or drive the row anew (`tools.write_results`), then the sample (`--write`).
"""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

import mdrive_sumo as md
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.agents.registry import DETECTOR_AGENTS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.terminal import echo
from tools.tool_command import HELP, ToolCommand
from tools.write_results import BASELINES, ROOT

EPISODES = Path("docs/results/episodes.json")
SHORT = (("i08_ins_ss_old_town", 1), ("pre-crash_09", 1))
"""Scenarios and seeds of most agents: those of two CAVs that end soonest, with a seed in which few agents reach 100."""
SAMPLE: Mapping[str, tuple[tuple[str, int], ...]] = {
    "stationary": SHORT[1:],
    "single": (SHORT[0], ("corridor_061", 0)),
    **{f"perception-swap:{name}:profile": SHORT[:1] for name in ("attfuse", "disconet", "fcooper", "cobevt")},
    **dict.fromkeys((*SYSTEMS, *DETECTOR_AGENTS), SHORT[1:]),
}
"""Agents with another sample than `SHORT`: those that need a second or more for an episode have one."""


def list_sample(agent: str) -> tuple[tuple[str, int], ...]:
    """Return scenario and seed of each sampled episode of an agent."""
    return SAMPLE.get(agent, SHORT)


def drive_episode(agent: str, scenario: str, seed: int) -> dict[str, Any]:
    """Return what is kept of an episode under the conditions of the rows: ideal channel, realistic sensing."""
    result = md.simulate(scenario, agent=agent, seed=seed, suite="mdrive@0").result
    return {"scenario": scenario, "seed": seed, "ds": round(result.ds, 6), "digest": result.digest}


def load_episodes(root: Path = ROOT) -> dict[str, list[dict[str, Any]]]:
    """Return the kept episodes by agent."""
    return json.loads((root / EPISODES).read_text("utf-8")) if (root / EPISODES).is_file() else {}


def drive_agents(agents: Iterable[str]) -> dict[str, list[dict[str, Any]]]:
    """Return the sampled episodes of agents, driven now."""
    return {agent: [drive_episode(agent, *episode) for episode in list_sample(agent)] for agent in agents}


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("agents", nargs=-1, metavar="[AGENT]...")
@click.option("--write", is_flag=True, help=f"Write {EPISODES} instead of comparing.")
def main(agents: Sequence[str], write: bool) -> None:
    """Drive the sampled episodes of the AGENTs, or of all with a row, and compare; exit code 1 if one differs."""
    rows = json.loads((ROOT / BASELINES).read_text("utf-8"))
    if unknown := [agent for agent in agents if agent not in rows]:
        raise InputError(f"agent: expected one with a row in {BASELINES}, found {unknown[0]}")
    kept, driven = load_episodes(), drive_agents(agents or rows)
    if write:
        write_text(ROOT / EPISODES, json.dumps({**kept, **driven}, indent=1) + "\n")
        return
    differing = [agent for agent, episodes in driven.items() if kept.get(agent) != episodes]
    for agent in differing:
        echo(f"{agent}: expected {kept.get(agent)}, found {driven[agent]}")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
