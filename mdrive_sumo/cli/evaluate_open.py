"""`mdrive-sumo eval-open`."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from mdrive_sumo.cli.evaluate import evaluate_with_display
from mdrive_sumo.cli.setting_options import episode_options, read_episode_options, setting_option
from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.open_loop import (
    LOG,
    OPEN_LOOP_FILE,
    REFERENCE_AGENT,
    OpenLoopResults,
    OpenLoopScenario,
    evaluate_open,
    find_reference,
    prepare_open_loop,
)
from mdrive_sumo.open_loop.results import OpenLoopMetrics
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig, load_agent_config

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
@click.option(
    "--reference",
    default=REFERENCE_AGENT,
    show_default=True,
    metavar=f"{REFERENCE_AGENT}|{LOG}|RUN",
    help=f"Recorded drives: of {REFERENCE_AGENT}, driven first; logs of a converted suite; those of a finished run.",
)
@setting_option("suite", help="The suite; that of RUN if it is one.")
@setting_option("scenario", help="Only the drives in scenarios whose id or category matches; may be repeated.")
@click.option(
    "--seed",
    type=click.IntRange(0, 2**31 - 1),
    default=0,
    show_default=True,
    help="Of the reference; of RUN all seeds unless given.",
)
@setting_option("agent", default="single", help="The agent that sees the drives; every CAV gets an instance of it.")
@setting_option("agent_config", help="Options of the agent, JSON.")
@setting_option("agent_limits")
@episode_options
@setting_option("workers")
@setting_option("sandbox", help="Run a third-party agent in boxes without the files of suite and reference.")
@setting_option("out", help="Folder of the results [default: runs/...].")
@setting_option("fresh", help="Start anew instead of continuing an interrupted evaluation.")
@click.pass_context
def command(
    ctx: click.Context, agent: str, agent_config: Path | None, out: Path | None, sandbox: bool, **options: Any
) -> None:
    """Compare an agent's plans and detections with recorded drives, without driving.

    The agent sees five frames a second of a recording, with messages over the channel. Each plan is compared with what
    the CAV did in the next 3 s, and detections with what was there within 70 m.

    Exit codes: 0 all recordings were compared, 1 the agent failed in some or one has no result, 2
    unusable input, 130 interrupted.
    """
    chosen, fresh, workers = read_episode_options(options), options.pop("fresh"), options.pop("workers")
    reference = find_reference(
        options["reference"],
        lambda config: _drive_reference(ctx, replace(config, workers=workers)),
        suite=_find_given(ctx, "suite"),
        pattern=options["scenario"],
        seed=_find_given(ctx, "seed"),
    )
    spec = AgentSpec(agent, load_agent_config(agent_config) if agent_config else {})
    spec = spec.with_limits(limits) if (limits := options["agent_limits"]) else spec
    open_run = prepare_open_loop(reference, spec, chosen, out, workers, sandbox=sandbox)
    try:
        results = evaluate_open(open_run, _report, fresh=fresh)
    except KeyboardInterrupt:
        echo(f"interrupted; the same command continues {open_run.folder}", err=True)
        ctx.exit(130)
    except WorldError as error:
        echo(f"Error: {error}", err=True)
        ctx.exit(1)
    echo(format_open_loop(results))
    skipped = sum((Counter(one.skipped) for one in results.scenarios), Counter[str]())
    if skipped:
        echo("\nnot compared: " + ", ".join(f"{count} frames with {why}" for why, count in skipped.items()))
    echo(f"\n{open_run.folder / OPEN_LOOP_FILE}  all numbers")
    failures = format_open_loop_failures(results)
    if failures:
        echo("\n" + failures)
    ctx.exit(1 if failures else 0)


def _find_given(ctx: click.Context, option: str) -> Any:
    """Return the value of an option that the user typed; None for the default."""
    is_default = ctx.get_parameter_source(option) is ParameterSource.DEFAULT
    return None if is_default else ctx.params[option]


def _drive_reference(ctx: click.Context, config: RunConfig) -> Path:
    """Drive the reference unless it is finished; return its folder."""
    run = prepare(config)
    echo(f"reference {config.agent.name}: {run.folder}", err=True)
    evaluate_with_display(ctx, run, evaluate)
    return run.folder


def _report(done: int, total: int, result: OpenLoopScenario) -> None:
    echo(f"{done}/{total} {result.id}", err=True)


def format_open_loop_failures(results: OpenLoopResults) -> str:
    """Return a line for every failure of the agent; "" if it never failed."""
    rows = [(one, ego, reason) for one in results.scenarios for ego, reason in one.failures.items()]
    return "\n".join(f"agent failed: {one.id} seed {one.seed}, CAV {ego}: {reason}" for one, ego, reason in rows)


def format_open_loop(results: OpenLoopResults) -> str:
    """Return the table that the command prints."""
    rows = [(name, *_format_metrics(found)) for name, found in results.buckets.items()]
    rows.append(("all", *_format_metrics(results.overall)))
    return format_text(make_text_table(("bucket", *COLUMNS.values()), rows))


def _format_metrics(metrics: OpenLoopMetrics) -> tuple[str, ...]:
    values = [getattr(metrics, name) for name in COLUMNS]
    return tuple(
        "-" if value is None else f"{value:.2f}" if isinstance(value, float) else str(value) for value in values
    )
