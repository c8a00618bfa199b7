"""`mdrive-sumo learn observation`."""

from contextlib import closing
from pathlib import Path

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.runs.evaluate import report_write_errors

ON_ROUTE = 10
"""The target that keeps to the route at 8 m/s, see `rl.driving_actions.TARGETS`."""


@click.command("observation")
@click.argument("scenario")
@click.option("--suite", default="interdrive@0", show_default=True, help="Name or folder of its suite.")
@click.option("--cav", type=click.IntRange(0, 63), default=0, show_default=True, help="Place in the scenario file.")
@click.option(
    "--tick", type=click.IntRange(0, 20_000), default=0, show_default=True, help="A tick of a decision or the next one."
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="0 is the scenario as written.")
@click.option("--view", type=click.Choice(("own", "privileged")), default="own", show_default=True)
@click.option("--grid", type=click.Choice(("raster", "lidar")), help="Show this grid, too.")
@click.option(
    "--nearest", type=click.IntRange(0, 64), default=8, show_default=True, help="Road users in the observation."
)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="The page.")
def command(
    scenario: str, suite: str, cav: int, tick: int, seed: int, view: str, grid: str | None, nearest: int, out: Path
) -> None:
    """Write a page that shows what a policy sees in a tick of SCENARIO.

    Until then all CAVs keep to their routes at 8 m/s. Needs the extra `rl`.
    """
    from mdrive_sumo.rl import ParallelDrivingEnv

    env = ParallelDrivingEnv(
        suite=suite, scenarios=[scenario], view=view, grid=grid or "", nearest=nearest, control="targets",
        own_process=False,
    )  # fmt: skip
    with closing(env):
        env.reset(options={"scenario_seed": seed})
        agent = f"cav_{cav}"
        driven = 0
        while driven < tick and agent in env.agents:
            env.step(dict.fromkeys(env.agents, ON_ROUTE))
            driven += env.settings.ticks_per_decision
        if agent not in env.agents:
            found = f"it ended by tick {driven}" if agent in env.possible_agents else f"{len(env.possible_agents)} CAVs"
            raise InputError(f"scenario {scenario}: expected CAV {cav} to drive in tick {tick}, found {found}")
        page = env.obs_html(agent)
    with report_write_errors(out):
        make_parents(out)
        write_text(out, page)
    echo(str(out))
