"""Commands for authored sources (routes and scripted road users) and for maps."""

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from real2sim.cli.log_options import check_suite_name, name_option, out_option, paths_argument
from real2sim.readers.carla_frame import UCLA_FRAME, CarlaFrame

if TYPE_CHECKING:  # see log_options: commands import what they run
    from real2sim.carla.conversion_report import ConversionReport

towns_option = click.option(
    "--towns",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Maps of the CARLA towns: TownNN.xodr (compiled with netconvert) or TownNN.net.xml.",
)


def parse_carla_offset(_: click.Context, __: click.Parameter, value: str | None) -> CarlaFrame:
    """Parse the option --carla-offset."""
    if value is None:
        return UCLA_FRAME
    from real2sim.xml_file import parse_finite

    try:
        x, y, *turn = (parse_finite("--carla-offset", part) for part in value.split(","))
        (yaw,) = turn or (0.0,)
    except ValueError:
        raise click.BadParameter(f"expected X,Y or X,Y,YAW, found {value!r}") from None
    return CarlaFrame(x, y, math.radians(yaw))


@click.command()
@paths_argument
@towns_option
@click.option(
    "--map",
    "vector_map",
    type=click.Path(path_type=Path),
    metavar="PICKLE",
    help="V2XPnP's vector map, instead of towns.",
)
@click.option(
    "--carla-offset",
    "frame",
    callback=parse_carla_offset,
    metavar="X,Y[,YAW]",
    help=f"Where CARLA's origin lies in the vector map, in m and degrees [default: {UCLA_FRAME.x:g},{UCLA_FRAME.y:g}].",
)
@out_option
@name_option
def mdrive(
    paths: tuple[Path, ...], towns: Path | None, vector_map: Path | None, frame: CarlaFrame, out: Path, name: str | None
) -> None:
    """Convert MDrive scenario directories (routes, actors_manifest.json, behaviours), or folders of such."""
    if (towns is None) == (vector_map is None):
        raise InputError("mdrive: expected either --towns or --map, found " + ("both" if towns else "neither"))
    from mdrive_sumo.scenario.suite import SuiteFile
    from real2sim.authored.suite_converter import convert_authored
    from real2sim.pipeline.conversion_tasks import DESCRIPTION
    from real2sim.pipeline.limited_reader import read_vector_map_limited
    from real2sim.readers.mdrive import VectorMap, find_mdrive_folders, read_mdrive

    place = VectorMap(read_vector_map_limited(vector_map), frame) if vector_map else towns
    assert place is not None
    scenes = [read_mdrive(folder, place) for folder in find_mdrive_folders(paths)]
    wanted = check_suite_name(out, name)
    about = SuiteFile(name=wanted, title=wanted, description=DESCRIPTION)
    echo(_format_report(convert_authored(scenes, out, about), out))


@click.command()
@paths_argument
@towns_option
@out_option
@name_option
def interdrive(paths: tuple[Path, ...], towns: Path | None, out: Path, name: str | None) -> None:
    """Convert InterDrive's route folders SRC/<scenario>/<name>_<number>.xml into a suite."""
    if towns is None:
        raise InputError("interdrive: expected the maps of the CARLA towns, found no --towns")
    from real2sim.authored.suite_converter import convert_interdrive

    echo(_format_report(convert_interdrive(paths, towns, out, check_suite_name(out, name) if name else None), out))


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="New folder of the network.")
@click.option("--name", metavar="NAME", help="Name of the network [default: that of the file].")
@click.option("--left-hand", is_flag=True, help="Traffic keeps left; for OpenStreetMap, which does not say it.")
def network(file: Path, out: Path, name: str | None, left_hand: bool) -> None:
    """Convert your own map to a network for scenarios: SUMO net, OpenDRIVE or OpenStreetMap.

    FILE is a .net.xml, .xodr or .osm file, gzipped or not. DIR/conversion.md lists what could not be kept, and what of
    it CAVs cannot drive.
    """
    from real2sim.own_maps import convert_map

    found = convert_map(file, out, name, left_hand)
    facts = found.drivability
    signs = "stop signs unknown" if found.stop_signs is None else f"{found.stop_signs} stop signs"
    echo(
        f"{found.name}: {found.kind}, {facts.lanes} lanes of {facts.metres / 1000:.1f} km, {facts.junctions} junctions,"
        f" {found.signals} traffic lights, {signs}, {found.buildings} buildings"
    )
    for line in found.lost:
        echo(f"not kept: {line}")
    for line in facts.findings:
        echo(f"check: {line}")
    quoted = shlex.quote(str(out))
    echo(f"Look at it and click routes: mdrive-sumo view {quoted}")
    echo(f'Write scenarios on it: md.worlds.load("{out}").new_scenario("my_scenario"), see docs/how-to/own-scenario.md')


@click.command()
@paths_argument
@out_option
def opendrive(paths: tuple[Path, ...], out: Path) -> None:
    """Convert OpenDRIVE maps NAME.xodr into network folders DIR/networks/NAME, ready for scenarios."""
    from real2sim.carla.conversion_report import NETWORKS_MARKDOWN
    from real2sim.carla.opendrive_converter import convert_opendrive

    for town in convert_opendrive(paths, out):
        signs = "stop signs unknown" if town.stop_signs is None else f"{town.stop_signs} stop signs"
        facts = f"{'left-hand, ' * town.left_hand}{signs}, {len(town.repairs)} repairs"
        lanes = f"{town.displaced_lanes} of {town.measured_lanes} lanes compared over 0.5 m off the map"
        echo(f"{town.name}: {facts}, {lanes}")
    echo(f"Report: {out / NETWORKS_MARKDOWN}")
    echo(f"Draw them: mdrive-sumo show {shlex.quote(str(out))}")
    echo("Drive on them: add suite.json and <id>/scenario.json (`mdrive-sumo schema suite`, `schema scenario`)")


def _format_report(report: "ConversionReport", out: Path) -> str:
    from real2sim.carla.conversion_report import REPORT_MARKDOWN

    numbers = report.statistics
    lines = (
        f"{numbers.scenarios} scenarios, {numbers.cavs} CAVs, mean route {numbers.mean_route_m:.2f} m,"
        f" mean heading change {numbers.mean_heading_change_deg:.2f} deg",
        f"{len(report.shifts)} starts moved apart; {len(report.left_out)} of {report.waypoints} waypoints"
        f" left out; {len(report.off_lane)} over {report.off_lane_threshold_m:g} m off their lane"
        f" ({report.starts_off_lane} starts)",
        *report.notes,
        f"Report: {out / REPORT_MARKDOWN}",
        f"Run it: mdrive-sumo eval --suite {out}",
    )
    return "\n".join(lines)
