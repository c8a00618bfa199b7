"""`mdrive-sumo eval-open`."""

from pathlib import Path
from typing import Any

import click

from mdrive_sumo.cli.comm import episode_options, read_episode_options
from mdrive_sumo.cli.evaluate import evaluate_with_display
from mdrive_sumo.cli.workers import workers_option
from mdrive_sumo.core.tables import format_text_table
from mdrive_sumo.open_loop import OPEN_LOOP_FILE, OpenLoopResults, OpenLoopScenario, evaluate_open, prepare_open_loop
from mdrive_sumo.open_loop.results import OpenLoopMetrics
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig, load_agent_config
from mdrive_sumo.runs.stored_run import load_stored_run

REFERENCE_AGENT = "omniscient"
COLUMNS = {
    "ap50": "AP50 [%]",
    "ade": "ADE [m]",
    "fde": "FDE [m]",
    "cr": "CR [%]",
    "cr_frames": "CR frames [%]",
    "cr_mdrive": "CR mdrive [%]",
    "overlap": "overlap [%]",
    "frames": "frames",
}


@click.command("eval-open")
@click.option("--reference", type=click.Path(path_type=Path), metavar="RUN", help="Finished run with recordings.")
@click.option(
    "--suite",
    default="interdrive",
    show_default=True,
    metavar="NAME|DIR",
    help=f"Without --reference: what {REFERENCE_AGENT} drives first.",
)
@click.option("--scenario", default="*", metavar="GLOB", help="Without --reference: only these scenarios.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, show_default=True, help="Of the reference.")
@click.option("--agent", default="single", show_default=True, metavar="NAME|module:Class|path.py:Class|carla:path.py")
@click.option("--agent-config", type=click.Path(path_type=Path), metavar="FILE", help="Options of the agent, JSON.")
@episode_options
@workers_option
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder of the results [default: runs/...]."
)
@click.option("--fresh", is_flag=True, help="Start anew instead of continuing an interrupted evaluation.")
@click.pass_context
def command(
    ctx: click.Context, reference: Path | None, agent: str, agent_config: Path | None, out: Path | None, **options: Any
) -> None:
    """Compare an agent's plans and detections with recorded drives, without driving.

    The agent sees five frames a second of a recording, with messages over the channel. Each plan is compared with what
    the CAV did in the next 3 s, and detections with what was there within 70 m.

    Exit codes: 0 all recordings were compared, 2 unusable input, 130 interrupted.
    """
    chosen, fresh = read_episode_options(options), options.pop("fresh")
    if reference is None:
        reference = _drive_reference(ctx, RunConfig(agent=AgentSpec(REFERENCE_AGENT), **options))
    spec = AgentSpec(agent, load_agent_config(agent_config) if agent_config else {})
    open_run = prepare_open_loop(load_stored_run(reference), spec, chosen, out, options["workers"])
    try:
        results = evaluate_open(open_run, _report, fresh=fresh)
    except KeyboardInterrupt:
        click.echo(f"interrupted; the same command continues {open_run.folder}", err=True)
        ctx.exit(130)
    click.echo(format_open_loop(results))
    click.echo(f"\n{open_run.folder / OPEN_LOOP_FILE}  all numbers")


def _drive_reference(ctx: click.Context, config: RunConfig) -> Path:
    """Drive the reference unless it is finished; return its folder."""
    run = prepare(config)
    click.echo(f"reference {config.agent.name}: {run.folder}", err=True)
    evaluate_with_display(ctx, run, evaluate)
    return run.folder


def _report(done: int, total: int, result: OpenLoopScenario) -> None:
    click.echo(f"{done}/{total} {result.id}", err=True)


def format_open_loop(results: OpenLoopResults) -> str:
    """Return the table that the command prints."""
    rows = [(name, *_format_metrics(found)) for name, found in results.buckets.items()]
    rows.append(("all", *_format_metrics(results.overall)))
    return format_text_table(("bucket", *COLUMNS.values()), rows)


def _format_metrics(metrics: OpenLoopMetrics) -> tuple[str, ...]:
    values = [getattr(metrics, name) for name in COLUMNS]
    return tuple(
        "-" if value is None else f"{value:.2f}" if isinstance(value, float) else str(value) for value in values
    )
