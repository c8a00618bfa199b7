"""`mdrive-sumo study channel`: what the channel of recorded runs did."""

import shlex
from pathlib import Path

import click

from mdrive_sumo.cli.options import get_command_line
from mdrive_sumo.cli.stored_run_options import moved_suite_option
from mdrive_sumo.core.atomic_folder import atomic_folder, check_new_folder
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.private_paths import hide_command
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.runs.stored_run import load_stored_run
from mdrive_sumo.study.channel.channel_figures import draw_ages, draw_awareness, draw_busy, draw_gaps, draw_reception
from mdrive_sumo.study.channel.channel_files import (
    awareness_csv,
    build_summary_table,
    busy_csv,
    channel_json,
    channel_markdown,
    reception_csv,
    times_csv,
)
from mdrive_sumo.study.channel.channel_study import measure_runs


@click.command("channel")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@click.option("--scenario", "patterns", multiple=True, metavar="GLOB", help="Only these; repeatable [default: all].")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="New or empty folder.")
@moved_suite_option
def channel_command(runs: tuple[Path, ...], patterns: tuple[str, ...], out: Path, suite: str | None) -> None:
    """Measure what the channel did in recorded runs: reception, gaps, age of information, awareness.

    RUN is a folder written by `eval`; nothing is driven again. Writes reception.csv (packet reception ratio over
    distance by class of links and type of message), gaps.csv (time between receptions), ages.csv (age of information),
    awareness.csv (road users that CAVs know of), of runs over a radio busy.csv (channel busy ratio), a picture for
    each, channel.json and channel.md into --out, all or nothing.

    Exit codes: 0 done, 2 unusable input.
    """
    check_new_folder(out)
    loaded = [(folder, load_stored_run(folder, suite)) for folder in runs]
    measured = measure_runs(loaded, patterns, lambda name: echo(name, err=True))
    command = hide_command(get_command_line(), out)
    has_radio = any(run.loads.by_second for run in measured)
    with atomic_folder(out) as draft:
        pictures = [
            draw(measured, draft / stem)[0].name
            for draw, stem in (
                (draw_reception, "reception"),
                (draw_gaps, "gaps"),
                (draw_ages, "ages"),
                (draw_awareness, "awareness"),
                *(((draw_busy, "busy"),) if has_radio else ()),
            )
        ]
        pages = {
            "reception.csv": reception_csv(measured),
            "gaps.csv": times_csv(measured, "gaps"),
            "ages.csv": times_csv(measured, "ages"),
            "awareness.csv": awareness_csv(measured),
            **({"busy.csv": busy_csv(measured)} if has_radio else {}),
            "channel.json": channel_json(measured, command),
            "channel.md": channel_markdown(measured, shlex.join(command), pictures),
        }
        for name, text in pages.items():
            write_text(draft / name, text)
    echo("\n\n".join((format_text(build_summary_table(measured)), "\n".join(map(str, sorted(out.iterdir()))))))
