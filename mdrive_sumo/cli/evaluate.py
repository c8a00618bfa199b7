"""`mdrive-sumo eval`."""

import shlex
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.api.evaluation import evaluate_run
from mdrive_sumo.cli.options import get_command_line
from mdrive_sumo.cli.setting_options import read_channel, run_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.agent_failures import format_agent_failures, format_first_failure
from mdrive_sumo.report.progress import ProgressDisplay
from mdrive_sumo.report.result_tables import format_summary
from mdrive_sumo.report.run_report import REPORT_FILE, save_run_report
from mdrive_sumo.runs.evaluate import RESULTS_FILE, Progress, StoppedAtFailure, evaluate, start_workers
from mdrive_sumo.runs.journal import JOURNAL_FILE
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare
from mdrive_sumo.runs.run_config import RunConfig, load_agent_config
from mdrive_sumo.runs.run_paths import CAMERAS_FOLDER, EPISODES_FOLDER, LOGS_FOLDER
from mdrive_sumo.scoring import Results
from mdrive_sumo.scoring.captured_cooperation import CapturedCooperation
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks
from mdrive_sumo.study.study_runs import evaluate_captured_cooperation

EXECUTORS = ("local", "dask")


@click.command("eval")
@run_options(
    before={
        "seeds": click.option(
            "--transcript",
            type=click.Path(path_type=Path, exists=True, dir_okay=False),
            metavar="FILE",
            help="Answers of a language model from an earlier run's transcript.jsonl, instead of an endpoint.",
        ),
        "scheduler": click.option(
            "--executor",
            type=click.Choice(EXECUTORS),
            default=EXECUTORS[0],
            show_default=True,
            help="Where episodes run: processes here, or the workers of a Dask cluster.",
        ),
    }
)
@click.option("--captured", is_flag=True, help="Drive the references for captured cooperation too, and show it.")
@click.pass_context
def command(ctx: click.Context, transcript: Path | None, executor: str, captured: bool, **options: Any) -> None:
    """Drive a suite with an agent and score it.

    The same command given again continues an interrupted run; it also tries void scenarios again. A scenario
    whose worker died is retried once, then it is void: the benchmark's failure or SUMO's, never the agent's.
    A failure of the agent (crash, time-out, invalid reply) is scored, and the end of its log is shown.

    Exit codes: 0 every scenario has a score and no agent failed, 1 some are void or the agent failed, 2 unusable
    input, 130 interrupted.
    """
    if (executor == "dask") != bool(options["scheduler"]):
        raise InputError(f"--executor {executor}: expected --scheduler with dask and only then")
    config = _read_config(options, transcript)
    with start_workers(config) as started:
        run = prepare(config)
        if len(run.episodes) > 1 and (config.fresh or not (run.folder / RESULTS_FILE).is_file()):
            echo(describe_cost(run), err=True)
        whole = evaluate_with_display(ctx, run, partial(evaluate_run, executor=started))
    shares = with_references(ctx, whole, config) if captured else None
    if shares is not None:
        save_run_report(run.folder, whole, shares)
    echo(format_summary(whole, shares))
    echo("\n" + _list_written_files(run))
    failures = format_agent_failures(whole, run.folder)
    if failures:
        echo("\n" + failures)
    ctx.exit(1 if whole.void or failures else 0)


def describe_cost(run: PreparedRun) -> str:
    """Return how much a run of several episodes drives: "92 episodes (46 scenarios, 2 seeds), ..., at most 61 min"."""
    scenarios, seeds = run.scenarios, len(run.config.seeds)
    drives = seeds * sum(len(scenario.egos) for scenario in scenarios)
    limit_s = seeds * sum(max(compute_time_limit_ticks(scenario).values()) * DT for scenario in scenarios)
    what = f"{len(scenarios)} scenario{'s' * (len(scenarios) > 1)}" + (f", {seeds} seeds" if seeds > 1 else "")
    hint = "; --scenario GLOB drives fewer" if len(scenarios) > 1 and run.config.scenario == "*" else ""
    limit = f"{limit_s:.0f} s" if limit_s < 120.0 else f"{limit_s / 60:.0f} min"
    return f"{len(run.episodes)} episodes ({what}), {drives} drives of CAVs, at most {limit} of simulated time{hint}"


def _read_config(options: dict[str, Any], transcript: Path | None) -> RunConfig:
    """Return the run that the options of the command line ask for. Raises InputError."""
    file, first = options.pop("agent_config"), options.pop("seed")
    agent_config = load_agent_config(file) if file else {}
    if transcript is not None:
        agent_config["transcript"] = str(transcript.resolve())
    seeds = range(first, first + options.pop("seeds"))
    config = RunConfig.parse(agent_config=agent_config, seeds=seeds, comm=read_channel(options), **options)
    return replace(config, command=get_command_line())


def with_references(ctx: click.Context, results: Results, config: RunConfig) -> CapturedCooperation:
    """Return the captured cooperation of a run. Its references are driven unless finished. Raises InputError."""

    def evaluate_reference(run: PreparedRun) -> Results:
        echo(f"reference {run.config.agent.name}, --comm {run.config.options.comm.preset}: {run.folder}", err=True)
        return evaluate_with_display(ctx, run, evaluate)

    return evaluate_captured_cooperation(results, config, evaluate_reference)


def evaluate_with_display(
    ctx: click.Context, run: PreparedRun, drive: Callable[[PreparedRun, Progress], Results]
) -> Results:
    """Drive a run with a progress display on standard error; Ctrl-C exits with code 130."""
    progress = ProgressDisplay(sys.stderr)
    try:
        return drive(run, progress)
    except StoppedAtFailure as stopped:
        progress.close()
        echo(format_first_failure(stopped.result, run.folder, is_seeded=run.config.has_many_seeds))
        echo(f"stopped; --fresh starts {run.folder} anew, without --fail-fast it is continued", err=True)
        ctx.exit(1)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not swallow the answer to the first
        progress.close()
        again = "the same command" + (" without --fresh" if run.config.fresh else "")
        echo(f"interrupted; {again} continues {run.folder}", err=True)
        ctx.exit(130)
    finally:
        progress.close()


def _list_written_files(run: PreparedRun) -> str:
    files = {RESULTS_FILE: "all numbers", REPORT_FILE: "to read", JOURNAL_FILE: "what was done"}
    if not run.config.is_builtin:
        files[f"{LOGS_FOLDER}/"] = "output of the agent's processes"
    if run.config.record:
        files[f"{EPISODES_FOLDER}/"] = "recordings, for view, verify and rescore"
    if (run.folder / CAMERAS_FOLDER).is_dir():
        files[f"{CAMERAS_FOLDER}/"] = "images of cameras, for view"
    lines = [f"{run.folder / name}  {what}" for name, what in files.items()]
    if run.config.record_cameras and not (run.folder / CAMERAS_FOLDER).is_dir():
        lines.append("no camera images: --record-cameras keeps those of kind rgb, and the agent was given none")
    return "\n".join((*lines, f"mdrive-sumo view {shlex.quote(str(run.folder))}  what each CAV lost, in the browser"))
