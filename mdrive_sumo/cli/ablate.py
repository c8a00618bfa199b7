"""`mdrive-sumo study ablate`."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.cli.options import make_scenario_option, workers_option
from mdrive_sumo.cli.stored_run_options import (
    choose_seed,
    find_one_scenario,
    foreign_agent_options,
    moved_suite_option,
    read_permission,
)
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.result_tables import format_optional
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.recording_check import load_recording
from mdrive_sumo.runs.stored_run import load_stored_run
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.study.ablation import (
    AblationResult,
    MuteEffect,
    ablate,
    choose_mutes,
    compute_ttc_change,
    rank_effects,
)

HEADER = (
    *("without", "messages", "DS", "change", "SR", "efficient SR", "time ratio"),
    *("min TTC [s]", "change", "parts at tick"),
)


@click.command("ablate")
@click.argument("run_folder", metavar="RUN", type=click.Path(path_type=Path))
@make_scenario_option("Which episode of the run; it must fit exactly one.")
@click.option("--seed", type=int, help="Which one in a run of several seeds [default: the first].")
@click.option("--mute", multiple=True, metavar="SENDER/TYPE[@TICK]", help="Mute only these messages; * is any.")
@click.option("--each-message", metavar="TYPE", help="Mute every message of that type, each alone.")
@click.option("--max-runs", type=click.IntRange(min=1), default=100, show_default=True, help="Largest number of runs.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
@moved_suite_option
@foreign_agent_options
@workers_option
@click.pass_context
def command(
    ctx: click.Context, run_folder: Path, scenario: str, suite: str | None, as_json: bool, **choice: Any
) -> None:
    """The value of a message: execute a recorded episode again without it.

    Everything else is as `verify` does it; a third-party agent needs the same permission. Without --mute and
    --each-message every sender and every type of delivered message is muted, each alone. Reported are the driving
    score, the least time to collision, and the first tick in which a road user is somewhere else. The largest effect
    comes first.

    Exit codes: 0 done, 1 the recording itself comes out differently, 2 unusable input, 130 interrupted.
    """
    stored = load_stored_run(run_folder, suite)
    permission = read_permission(choice)
    run, results = permission.apply(stored.run), stored.results
    if changed := stored.describe_version_changes():
        echo(f"warning: the run was made with another {changed}", err=True)
    recorded = _find_recorded(run, results, scenario, choose_seed(results, choice["seed"]))
    messages = load_recording(run, recorded).messages
    mutes = choose_mutes(messages, choice["mute"], choice["each_message"], choice["max_runs"])
    effects = ablate(run, recorded, mutes, choice["workers"])
    if differing := next(effects).difference:
        echo(f"{recorded.id}: the recording itself comes out differently: {differing}", err=True)
        ctx.exit(1)
    ranked = rank_effects(recorded, _collect_effects(effects, len(mutes)))
    echo(format_ablation_json(ranked) if as_json else format_ablation_table(ranked))


def _find_recorded(run: PreparedRun, results: Results, pattern: str, seed: int) -> ScenarioResult:
    chosen = find_one_scenario(replace(run.suite, scenarios=run.scenarios), pattern)
    result = next(result for result in results.scenarios if result.key == (chosen.id, seed))
    if result.status == "void" or not run.find_recording(result.key).is_file():
        raise InputError(f"{run.folder}: expected a recording of {result.id}, found none")
    return result


def _collect_effects(effects: Iterator[MuteEffect], total: int) -> list[MuteEffect]:
    """Return all effects and print a line on stderr for each."""
    collected: list[MuteEffect] = []
    for effect in effects:
        collected.append(effect)
        echo(f"{len(collected)}/{total}  without {' '.join(effect.mute)}", err=True)
    return collected


def format_ablation_table(found: AblationResult) -> str:
    """Return the table for the terminal: the recorded episode, then every effect."""
    was = found.recorded
    rows = [("nothing", "0", f"{was.ds:.2f}", "", *_format_success(was), _format_seconds(was.min_ttc), "", "")]
    rows += [_format_cells(was, effect) for effect in found.effects]
    return f"{was.id}: {was.ticks} ticks\n\n" + format_text(make_text_table(HEADER, rows))


def _format_cells(was: ScenarioResult, effect: MuteEffect) -> tuple[str, ...]:
    now, change = effect.result, compute_ttc_change(was, effect.result)
    return (
        " ".join(effect.mute),
        str(effect.messages),
        f"{now.ds:.2f}",
        f"{now.ds - was.ds:+.2f}",
        *_format_success(now),
        _format_seconds(now.min_ttc),
        "" if change is None else f"{change:+.2f}",
        "never" if effect.parted is None else f"{effect.parted} ({effect.parted * DT:.2f} s)",
    )


def _format_success(result: ScenarioResult) -> tuple[str, str, str]:
    return f"{result.sr:.2f}", format_optional(result.efficient_sr), format_optional(result.time_ratio)


def _format_seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def format_ablation_json(found: AblationResult) -> str:
    """Return all effects as JSON."""
    was = found.recorded
    page = {
        "format": "mdrive-sumo/ablation/1",
        "scenario": was.id,
        "seed": was.seed,
        "recorded": was.model_dump(include={"ds", "sr", "efficient_sr", "time_ratio", "min_ttc", "ticks", "digest"}),
        "effects": [_effect_to_dict(was, effect) for effect in found.effects],
    }
    return json.dumps(page, indent=1, allow_nan=False)


def _effect_to_dict(was: ScenarioResult, effect: MuteEffect) -> dict[str, object]:
    now, change = effect.result, compute_ttc_change(was, effect.result)
    return {
        "mute": effect.mute,
        "messages": effect.messages,
        "ds": now.ds,
        "ds_change": round(now.ds - was.ds, 6),
        "sr": now.sr,
        "sr_change": round(now.sr - was.sr, 6),
        "efficient_sr": now.efficient_sr,
        "time_ratio": now.time_ratio,
        "min_ttc": now.min_ttc,
        "min_ttc_change": None if change is None else round(change, 6),
        "ticks": now.ticks,
        "parted": effect.parted,
        "first_difference": effect.difference,
        "digest": now.digest,
    }
