"""`mdrive-sumo convert`: foreign scenarios become suites."""

from pathlib import Path

import click

from real2sim.conversion_report import REPORT_MARKDOWN, ConversionReport
from real2sim.interdrive import convert_interdrive


@click.group()
def convert() -> None:
    """Turn recordings and foreign scenario files into suites."""


@convert.command()
@click.argument("source", type=click.Path(path_type=Path), metavar="SRC")
@click.option(
    "--towns",
    "maps",
    type=click.Path(path_type=Path),
    required=True,
    metavar="DIR",
    help="Maps of the CARLA towns: TownNN.xodr (compiled with netconvert) or TownNN.net.xml.",
)
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="New suite folder.")
def interdrive(source: Path, maps: Path, out: Path) -> None:
    """Convert InterDrive's route folders SRC/<scenario>/<name>_<number>.xml into a suite."""
    click.echo(_summary(convert_interdrive(source, maps, out), out))


def _summary(report: ConversionReport, out: Path) -> str:
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
