"""`mdrive-sumo study gain`: what sharing gains, and by what."""

import sys
from dataclasses import dataclass
from pathlib import Path

import click

from mdrive_sumo.cli.comm import parse_comm_options
from mdrive_sumo.cli.scenario_option import scenario_option
from mdrive_sumo.cli.study_display import drive_with_display, warn_about_failures
from mdrive_sumo.cli.workers import workers_option
from mdrive_sumo.core.tables import format_text_table
from mdrive_sumo.loop import EpisodeOptions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.study.gain import AGENTS, GainStudy, summarise_gain
from mdrive_sumo.study.gain_files import GAIN_HEADER, gain_csv, gain_json, gain_markdown, make_gain_table
from mdrive_sumo.study.study_files import StudyDescription
from mdrive_sumo.v2x.comm_settings import PRESETS


@click.command("gain")
@click.option("--suite", default="mdrive", show_default=True, metavar="NAME|DIR", help="What to drive.")
@scenario_option
@click.option("--comm", default="ideal", show_default=True, metavar="|".join(PRESETS), help="The V2X channel.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=1, show_default=True, help="The first seed.")
@click.option("--seeds", type=click.IntRange(1, 1000), default=5, show_default=True, help="How many seeds.")
@click.option("--no-record", is_flag=True, help="Keep no recordings: no view or verify of single runs.")
@click.option("--fresh", is_flag=True, help="Start anew instead of continuing an interrupted study.")
@click.option("--out", required=True, type=click.Path(path_type=Path), metavar="DIR", help="The study's folder.")
@workers_option
@click.pass_context
def command(ctx: click.Context, **options: object) -> None:
    """Split the gain of sharing into occlusion, noise and intent.

    Drives single, sharing and sharing+negotiation under both sensing profiles. Writes gain.json, gain.csv and
    gain.md into --out, and every run into --out/runs. The same command given again continues an interrupted study.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = _GainOptions(**options)  # pyright: ignore[reportArgumentType] - click has made them what the fields say
    seeds = tuple(range(given.seed, given.seed + given.seeds))
    study = GainStudy({name: given.prepare_agent(name) for name in AGENTS}, seeds, given.out)
    rows = drive_with_display(ctx, study)
    summary = summarise_gain(rows)
    suite = rows[0].results[0].run.suite
    about = StudyDescription(suite, given.scenario, "", {}, seeds, ("mdrive-sumo", *sys.argv[1:]))
    pages = {
        "gain.json": gain_json(about, rows, summary),
        "gain.csv": gain_csv(summary),
        "gain.md": gain_markdown(about, rows, summary),
    }
    for name, text in pages.items():
        with report_write_errors(given.out / name):
            (given.out / name).write_text(text, encoding="utf-8")
    click.echo(format_text_table(GAIN_HEADER, make_gain_table(summary)))
    click.echo("\n" + "\n".join(str(given.out / name) for name in pages))
    failed = warn_about_failures((one for row in rows for one in row.results), given.out)
    ctx.exit(1 if failed or summary.void else 0)


@dataclass(frozen=True, slots=True)
class _GainOptions:
    """The options of `study gain`."""

    suite: str
    scenario: str
    comm: str
    seed: int
    seeds: int
    no_record: bool
    fresh: bool
    out: Path
    workers: int

    def prepare_agent(self, name: str) -> PreparedRun:
        """Return the run of an agent with the first seed. Raises InputError."""
        config = RunConfig(
            suite=self.suite,
            scenario=self.scenario,
            agent=AgentSpec(name),
            seed=self.seed,
            options=EpisodeOptions(parse_comm_options(self.comm)),
            record=not self.no_record,
            workers=self.workers,
            out=self.out,
            fresh=self.fresh,
            command=("mdrive-sumo", *sys.argv[1:]),
        )
        return prepare(config)
