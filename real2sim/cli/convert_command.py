"""`mdrive-sumo convert`: convert recordings and scenario files of other tools to suites."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.plug_ins import PlugInKind, list_plug_ins
from mdrive_sumo.core.terminal import echo
from real2sim.cli.authored_commands import interdrive, mdrive, network, opendrive
from real2sim.cli.log_options import V2XPNP_FOLDER, log_options, match_file, match_folder, run_conversion
from real2sim.pipeline.log_source import ReaderPlugIn, load_reader_plug_in

map_option = click.option(
    "--map",
    "maps",
    type=click.Path(path_type=Path),
    multiple=True,
    metavar="FILE",
    help="Vector map (pickle), of several the one that the tracks lie on; for opv2v also OpenDRIVE.",
)


lanelet_option = click.option(
    "--map",
    "osm",
    type=click.Path(path_type=Path),
    metavar="OSM",
    help="Lanelet2 map, if not where the data set has it.",
)


class ConvertGroup(click.Group):
    """The sources of this package, and the readers of other packages (`mdrive_sumo.readers`)."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all sources."""
        return [*super().list_commands(ctx), *list_plug_ins(PlugInKind.READERS)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command of a source. Raises InputError for a plug-in that is no reader."""
        own = super().get_command(ctx, cmd_name)
        reader = None if own else load_reader_plug_in(cmd_name)
        return own if reader is None else _make_plug_in_command(cmd_name, reader)


def _make_plug_in_command(name: str, reader: ReaderPlugIn) -> click.Command:
    @click.command(name, help=reader.help or f"Convert {reader.pattern} with the reader of another package.")
    @log_options
    @click.pass_context
    def command(ctx: click.Context, **options: Any) -> None:
        run_conversion(ctx, name, match_file(reader.pattern), options)

    return command


@click.group(cls=ConvertGroup, invoke_without_command=True)
@click.option(
    "--summary",
    "suite",
    type=click.Path(path_type=Path),
    metavar="SUITE",
    help="How faithful a suite of converted logs is.",
)
@click.option(
    "--realism",
    "judged",
    type=click.Path(path_type=Path),
    multiple=True,
    metavar="SUITE",
    help="How likely the logs of a suite are under its traffic, and under SUMO's defaults; repeat it for more suites.",
)
@click.option(
    "--rollouts",
    type=click.IntRange(1, 64),
    default=8,
    show_default=True,
    help="With --realism: simulations of each log, each with another seed.",
)
@click.option("--drawn", is_flag=True, help="With --realism: also of the traffic that worlds draw on drawn places.")
@click.option("--json", "as_json", is_flag=True, help="With --summary or --realism: all figures as JSON.")
@click.pass_context
def convert(
    ctx: click.Context, suite: Path | None, judged: tuple[Path, ...], rollouts: int, drawn: bool, as_json: bool
) -> None:
    """Turn recordings and foreign scenario files into suites.

    network makes a network of your own map, for scenarios that you write.

    mdrive, interdrive and opendrive are authored sources: there is no log to compare with, so they take neither
    --report nor --window nor --cavs, and write conversion.md in place of quality.json and its summary.

    \b
    Exit codes: 0 every scenario meets the thresholds, 1 some do not (listed; the suite is written all the same),
    2 unusable input (nothing of it is written), 130 interrupted.
    """
    if suite is None and not judged and ctx.invoked_subcommand is None:
        echo(ctx.get_help())
        ctx.exit(0)
    if suite is None and not judged:
        return
    if suite is not None and judged:
        raise InputError("--summary: expected no --realism beside it: one report a call")
    if ctx.invoked_subcommand is not None:
        option = "--realism" if suite is None else "--summary"
        raise InputError(f"{option}: expected no source beside it, found {ctx.invoked_subcommand}")
    if suite is None:
        _show_realism(judged, rollouts, drawn, as_json)
        ctx.exit(0)
    from real2sim.pipeline.quality_file import load_qualities
    from real2sim.pipeline.suite_summary import format_summary, summarize_suite

    summary = summarize_suite(load_qualities(suite))
    echo(summary.model_dump_json(indent=1) if as_json else format_summary(summary))
    ctx.exit(0 if summary.all.passed else 1)


def _show_realism(suites: tuple[Path, ...], rollouts: int, drawn: bool, as_json: bool) -> None:
    from mdrive_sumo.scenario.suite import load_suite
    from real2sim.traffic_fidelity.drawn_traffic import DRAWN
    from real2sim.traffic_fidelity.realism_report import dump_realism, format_realism
    from real2sim.traffic_fidelity.traffic_realism import load_logged_scenarios, measure_realism

    logs = [log for suite in suites for log in load_logged_scenarios(load_suite(str(suite)))]
    table = measure_realism(logs, rollouts, tuple(DRAWN) if drawn else (), lambda name: echo(name, err=True))
    echo(dump_realism(table) if as_json else format_realism(table))


convert.add_command(mdrive)
convert.add_command(interdrive)
convert.add_command(opendrive)
convert.add_command(network)


@convert.command()
@log_options
@map_option
@click.option("--agents", metavar="ID,...", help="Agent folders to read [default: all].")
@click.pass_context
def v2xpnp(ctx: click.Context, maps: tuple[Path, ...], agents: str | None, **options: Any) -> None:
    """Convert V2XPnP scenarios: folders of agent folders with YAML frames, or folders with such in them."""
    if not maps:
        raise InputError("v2xpnp: expected the vector map, found no --map")
    names = tuple(agents.split(",")) if agents else None
    run_conversion(ctx, "v2xpnp", V2XPNP_FOLDER, options, maps=maps, agents=names)


@convert.command()
@log_options
@click.pass_context
def scenarionet(ctx: click.Context, **options: Any) -> None:
    """Convert ScenarioNet descriptions (nuScenes, Waymo, nuPlan): pickles, or folders of them."""
    run_conversion(ctx, "scenarionet", match_file("*.pkl"), options)


@convert.command()
@log_options
@click.pass_context
def commonroad(ctx: click.Context, **options: Any) -> None:
    """Convert CommonRoad scenarios: XML files, or folders of them."""
    run_conversion(ctx, "commonroad", match_file("*.xml"), options)


@convert.command()
@log_options
@click.pass_context
def argoverse2(ctx: click.Context, **options: Any) -> None:
    """Convert Argoverse 2: folders of a forecasting scenario or a sensor log, or folders with such in them."""
    run_conversion(ctx, "argoverse2", match_folder("*.parquet", "*.feather"), options)


@convert.command()
@log_options
@lanelet_option
@click.option("--cases", metavar="ID,...", help="Cases of tables with case_id (version 1.2) [default: all].")
@click.pass_context
def interaction(ctx: click.Context, osm: Path | None, cases: str | None, **options: Any) -> None:
    """Convert INTERACTION: vehicle_tracks_*.csv or DR_*_train.csv, or folders of them, with a Lanelet2 map.

    Logs of version 1.0 last minutes: choose a part with --window, or cut them with --every. Every case of version 1.2
    becomes a scenario.
    """
    wanted = tuple(cases.split(",")) if cases else None

    def find_cases(table: Path) -> tuple[str, ...]:
        return wanted or _find_cases(table)

    pattern = replace(match_file("vehicle_tracks_*.csv", "DR_*.csv"), find_cases=find_cases)
    run_conversion(ctx, "interaction", pattern, options, maps=(osm,) if osm else ())


def _find_cases(path: Path) -> tuple[str, ...]:
    """Return the cases of a table, or one without a name; the reader reports what is wrong with a table."""
    from real2sim.readers.interaction import list_cases

    try:
        return list_cases(path) or ("",)
    except InputError:
        return ("",)


@convert.command()
@log_options
@lanelet_option
@click.pass_context
def levelx(ctx: click.Context, osm: Path | None, **options: Any) -> None:
    """Convert inD, rounD, exiD and highD: NN_tracks.csv with the tables beside it, or folders of them.

    All but highD need their Lanelet2 map. The logs last minutes: choose a part with --window, or cut them with --every.
    """
    run_conversion(ctx, "levelx", match_file("*_tracks.csv"), options, maps=(osm,) if osm else ())


@convert.command()
@log_options
@map_option
@click.option("--agents", metavar="ID,...", help="Agent folders to read [default: all].")
@click.pass_context
def opv2v(ctx: click.Context, maps: tuple[Path, ...], agents: str | None, **options: Any) -> None:
    """Convert OPV2V, V2XSet, V2X-Real, V2V4Real: folders of agent folders with YAML frames, or folders with such.

    With an OpenDRIVE map (Town05.xodr) the log is in CARLA's frame, y to the right; with a vector map, or with matrices
    for poses as V2V4Real has them, in that map's.
    """
    if not maps:
        raise InputError("opv2v: expected the map of the town, found no --map")
    names = tuple(agents.split(",")) if agents else None
    run_conversion(ctx, "opv2v", V2XPNP_FOLDER, options, maps=maps, agents=names)


@convert.command()
@log_options
@click.option(
    "--map",
    "maps",
    type=click.Path(path_type=Path),
    multiple=True,
    metavar="JSON",
    help="Map of the crossing (*hdmap*.json); of several the one that the tracks lie on.",
)
@click.pass_context
def v2xseq(ctx: click.Context, maps: tuple[Path, ...], **options: Any) -> None:
    """Convert trajectories of V2X-Seq (DAIR-V2X): SCENE.csv, or folders of them, such as cooperative-trajectories."""
    if not maps:
        raise InputError("v2xseq: expected the map of the crossing, found no --map")
    run_conversion(ctx, "v2xseq", match_file("*.csv"), options, maps=maps)
