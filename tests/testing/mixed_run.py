"""A run of one short episode with everything that an export has to express. No tests in here."""

from pathlib import Path

from click.testing import CliRunner

from mdrive_sumo.cli import main
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion, ReplayMotion
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite
from testing.local_executor import TALKER
from testing.short_suite import shorten

SCENARIO = "mixed"
CAVS = ("0", "1")
GUEST = (1.0, 2.0)
"""Seconds between which the actor `guest` is there."""


def make_mixed_scenario() -> Scenario:
    """Return two CAVs among traffic lights, a walker, a cyclist, a cone, a truck, a guest and SUMO's traffic."""
    written = load_suite("interdrive@0").select("i01_ins_c_main_street_right")[0]
    walk = PathMotion(points=((20.0, 12.0), (20.0, 30.0)), speed=1.4, start_speed=1.4)
    ride = PathMotion(points=((30.0, 14.0), (60.0, 24.0)), speed=4.0, start_speed=4.0)
    visit = ReplayMotion(poses=((GUEST[0], -20.0, 20.0, 3.0), (GUEST[1], -26.0, 21.0, 3.0)))
    return shorten(written, 12).model_copy(
        update={
            "id": SCENARIO,
            "signals": "program",
            "actors": (
                Actor(
                    id="walker", kind="pedestrian", length=0.6, width=0.6, start=Pose(x=20, y=12, yaw=1.57), motion=walk
                ),
                Actor(
                    id="cyclist", kind="cyclist", length=1.8, width=0.6, start=Pose(x=30, y=14, yaw=0.3), motion=ride
                ),
                Actor(id="cone", kind="static", model="cone", length=0.4, width=0.4, start=Pose(x=40, y=30, yaw=0.5)),
                Actor(
                    id="truck",
                    kind="vehicle",
                    model="parked-truck",
                    length=8.5,
                    width=2.5,
                    start=Pose(x=-30, y=30, yaw=2),
                ),
                Actor(
                    id="guest", kind="vehicle", length=4.5, width=1.8, start=Pose(x=-20, y=20, yaw=3.0), motion=visit
                ),
            ),
            "background": Background(
                vehicles=(
                    BackgroundVehicle(
                        id="late", depart_s=0.5, edges=("south_in", "north_out"), depart_pos_m=40, depart_lane=1
                    ),
                )
            ),
        }
    )


def drive_mixed_run(folder: Path, *options: str) -> Path:
    """Drive the scenario with agents that talk, and return the run folder. Needs the fixture `in_process`."""
    suite, run = folder / "suite", folder / "run"
    save_suite(Suite(SuiteFile(name="mixed", title="Everything in one episode"), suite, (make_mixed_scenario(),)))
    words = ("eval", "--suite", suite, "--agent", TALKER, "--workers", "1", "--out", run, *options)
    ended = CliRunner().invoke(main, [str(word) for word in words])
    assert ended.exit_code == 0, ended.output
    return run
