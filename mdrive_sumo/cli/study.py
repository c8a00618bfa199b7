"""`mdrive-sumo study`: what cooperation is worth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from mdrive_sumo.cli.ablate import command as ablate_command
from mdrive_sumo.cli.paper import command as paper_command
from mdrive_sumo.cli.plug_in_group import PlugInGroup
from mdrive_sumo.cli.setting_options import add_options, parse_comm_options, seed_options, setting_option
from mdrive_sumo.cli.study_agents import cross_play_command, gain_command, penetration_command
from mdrive_sumo.cli.study_agreements import agreements_command
from mdrive_sumo.cli.study_attacks import attacks_command
from mdrive_sumo.cli.study_channel import channel_command
from mdrive_sumo.cli.study_options import (
    StudyOptions,
    agent_config_option,
    drive_with_display,
    parse_agent_configs,
    parse_agent_names,
)
from mdrive_sumo.cli.study_seasons import seasons_command
from mdrive_sumo.cli.study_twins import twins_command
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.study.conditions import (
    FACTORS,
    GRIDS,
    ChannelCondition,
    Level,
    make_conditions,
    make_off_condition,
    parse_levels,
    parse_pose_levels,
)
from mdrive_sumo.study.plots import draw_curves, make_curves
from mdrive_sumo.study.study_files import build_study_table, study_json, study_markdown
from mdrive_sumo.study.study_runs import BEST, Study
from mdrive_sumo.study.study_summary import StudyLine, summarise_rows
from mdrive_sumo.v2x.comm_settings import CommSettings

command = PlugInGroup(
    "study",
    "mdrive_sumo.study_commands",
    "Measure what cooperation is worth: the paper's tables, in parts, over worse channels, message by message.",
)
command.add_command(ablate_command)
command.add_command(agreements_command)
command.add_command(attacks_command)
command.add_command(channel_command)
command.add_command(cross_play_command)
command.add_command(gain_command)
command.add_command(penetration_command)
command.add_command(seasons_command)
command.add_command(twins_command)
command.add_command(paper_command)


@command.command("comm")
@setting_option("suite")
@setting_option("scenario")
@click.option("--agents", required=True, metavar="A,B,...", help="Agents, each as --agent of `eval`.")
@agent_config_option
@setting_option("agent_clock", help=None)
@setting_option("comm", help="The base channel.")
@click.option("--latency", metavar="TICKS,...", help="Latencies, in ticks of 0.05 s.")
@click.option("--loss", metavar="P,...", help="Probabilities of loss.")
@click.option("--pose-error", metavar="M,...", help="Standard deviations of senders' poses, in metres.")
@click.option("--rotation-error", metavar="DEG,...", help="The same in degrees [default: --pose-error's numbers].")
@click.option("--connected-background", metavar="P,...", help="Radios: shares of the background that send CAMs.")
@click.option("--channels", metavar="A,B,...", help="Further channels of --comm, to compare with the base channel.")
@click.option(
    "--grid", type=click.Choice(GRIDS), default=GRIDS[0], show_default=True, help="Combination of the factors."
)
@add_options(seed_options(first="The first seed; 0: as written.", count="How many seeds."))
@click.option(
    "--captured/--no-captured",
    default=True,
    show_default=True,
    help="Captured cooperation; drives its references, too.",
)
@setting_option("record", help="Keep no recordings: no view, verify or ablate of single runs.")
@setting_option("fresh", help="Start anew instead of continuing an interrupted study.")
@setting_option("out", required=True, help="The study's folder.")
@setting_option("agent_limits")
@setting_option("workers")
@click.pass_context
def comm_command(ctx: click.Context, **options: object) -> None:
    """Sweep latency, loss, pose error and load of the V2X channel over agents, or compare channels.

    One-at-a-time changes one factor and leaves the others as the base channel has them; full makes every
    combination. The same command given again continues an interrupted study. Writes study.json (all numbers),
    study.md (the table) and a picture for every factor into --out, and every run into --out/runs.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = _ChannelStudyOptions(**options)  # pyright: ignore[reportArgumentType] - click has made them what the fields say
    varied = given.varied()
    conditions = make_conditions(given.base(), varied, given.grid, given.list_channels())
    rows = drive_with_display(ctx, given.study(conditions))
    lines = summarise_rows(rows)
    about = given.describe(rows, given.grid, varied)
    pictures = _draw(lines, varied, conditions[0], given.out)
    pages = {
        "study.json": study_json(about, lines),
        "study.md": study_markdown(about, lines, [path for path in pictures if path.suffix == ".png"]),
    }
    table = format_text(build_study_table(lines, brief=True))
    given.end_study(
        ctx, [row for row in rows if not row.reused], pages, pictures, [table], sum(line.void for line in lines)
    )


@dataclass(frozen=True, slots=True)
class _ChannelStudyOptions(StudyOptions):
    """The options of `study comm`."""

    agents: str
    agent_config: tuple[str, ...]
    agent_clock: str
    latency: str | None
    loss: str | None
    pose_error: str | None
    rotation_error: str | None
    connected_background: str | None
    channels: str | None
    grid: str
    captured: bool

    def base(self) -> CommSettings:
        """Return the base channel. Raises InputError."""
        return parse_comm_options(self.comm)

    def list_channels(self) -> tuple[str, ...]:
        """Return the channels to compare with the base channel, as they are named."""
        return tuple(part.strip() for part in self.channels.split(",")) if self.channels is not None else ()

    def varied(self) -> dict[str, tuple[Level, ...]]:
        """Return the levels of every varied factor. Raises InputError, also if nothing at all is varied."""
        levels: dict[str, tuple[Level, ...]] = {}
        numbers = {
            "latency": self.latency, "loss": self.loss, "connected-background": self.connected_background,
        }  # fmt: skip
        for name, text in numbers.items():
            if text is not None:
                levels[name] = parse_levels(name, text)
        if self.pose_error is not None:
            levels["pose-error"] = parse_pose_levels(self.pose_error, self.rotation_error)
        elif self.rotation_error is not None:
            raise InputError("study: --rotation-error: expected --pose-error with it, found none")
        if not levels and self.channels is None:
            raise InputError(
                "study: expected at least one of --latency, --loss, --pose-error, --connected-background and"
                " --channels, found none"
            )
        return levels

    def study(self, conditions: tuple[ChannelCondition, ...]) -> Study:
        """Return the study; creates every agent once. Raises InputError."""
        names = parse_agent_names(self.agents)
        configs = parse_agent_configs(self.agent_config, names)
        agents = {name: self.prepare_agent(name, configs.get(name)) for name in names}
        best = agents.get(BEST) or self.prepare_agent(BEST) if self.captured else None
        return Study(
            agents, best, conditions, make_off_condition() if self.captured else None, self.all_seeds, self.out
        )

    def make_episode_options(self) -> EpisodeOptions:
        """Return the conditions of every episode: the base channel, the agents' clock. Raises InputError."""
        return EpisodeOptions.parse(comm=self.base(), agent_clock=self.agent_clock)


def _draw(
    lines: Sequence[StudyLine], varied: Mapping[str, Sequence[Level]], base: ChannelCondition, out: Path
) -> list[Path]:
    first = lines[0].row.results
    title = (
        f"{first[0].run.suite_label}: mean of {len(first[0].scenarios)} scenarios"
        f"{f' with {len(first)} seeds' if len(first) > 1 else ''}, shaded: 95 % intervals"
    )
    pictures: list[Path] = []
    for name in varied:
        curves = make_curves(lines, FACTORS[name], base)
        if curves:
            pictures += draw_curves(curves, FACTORS[name], title, out / name)
    return pictures
