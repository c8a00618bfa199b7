"""FCD, read back with sumolib and replayed by SUMO."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sumolib
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # it has no stubs here
from testing.mixed_run import CAVS, SCENARIO

from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads.netconvert import find_netconvert

from .conftest import Export

pytestmark = pytest.mark.slow  # of an episode that is driven

Point = tuple[int, str, Any]
"""Tick, id, and the attributes that sumolib has read."""


def read_points(path: Path) -> Iterator[Point]:
    for step in sumolib.xml.parse(str(path), "timestep"):
        for one in (*(step.vehicle or ()), *(step.person or ())):
            yield round(float(step.time) * TICKS_PER_SECOND), one.id, one


@pytest.mark.parametrize(("file", "schema"), [("fcd", "fcd_file"), ("types", "additional_file")])
def test_files_are_valid_by_the_schemas_of_sumo(exported: Export, file: str, schema: str) -> None:
    xsd = etree.XMLSchema(etree.parse(find_netconvert().parents[1] / "data" / "xsd" / f"{schema}.xsd"))
    xsd.assertValid(etree.parse(exported("fcd") / f"{SCENARIO}.{file}.xml"))


def test_sumolib_reads_the_recorded_poses(exported: Export, record: EpisodeRecord) -> None:
    """SUMO's position is half a length ahead of the centre; its angle is clockwise from north."""
    folder = exported("fcd")
    types = {one.id: one for one in sumolib.xml.parse(str(folder / f"{SCENARIO}.types.xml"), "vType")}
    found = np.zeros_like(record.valid)
    for tick, id_, one in read_points(folder / f"{SCENARIO}.fcd.xml"):
        column = record.ids.index(id_)
        found[tick, column] = True
        yaw = np.pi / 2 - np.radians(float(one.angle))
        back = float(types[one.type].length) / 2
        centre = (float(one.x) - back * np.cos(yaw), float(one.y) - back * np.sin(yaw))
        assert np.hypot(centre[0] - record.x[tick, column], centre[1] - record.y[tick, column]) < 1e-3
        assert np.cos(yaw - record.yaw[tick, column]) > 1 - 1e-9
        assert abs(float(one.speed) - record.speed[tick, column]) < 1e-3
    assert (found == record.valid).all()
    assert {one.vClass for one in types.values()} == {"passenger", "pedestrian", "bicycle", "truck", "ignoring"}


def test_sumo_replays_the_cavs_where_they_were(exported: Export, tmp_path: Path) -> None:
    """`sumo --device.fcd-replay.files`: the first and last tick are SUMO's own insertion and driving."""
    folder, sumo = exported("fcd"), find_netconvert().with_name("sumo")
    files = {
        "-n": folder / "main_street.net.xml.gz",
        "-a": folder / f"{SCENARIO}.types.xml",
        "--device.fcd-replay.files": folder / f"{SCENARIO}.fcd.xml",
        "--fcd-output": tmp_path / "replayed.xml",
    }
    options = ("--step-length=0.05", "--end=5", "--precision=4", "--no-step-log", "--collision.action=none")
    words = [str(word) for pair in files.items() for word in pair]
    home = {**os.environ, "SUMO_HOME": str(sumo.parent.parent)}
    subprocess.run([sumo, "--no-warnings", *words, *options], check=True, env=home)
    sent, replayed = (
        {(tick, id_): (float(one.x), float(one.y)) for tick, id_, one in read_points(path) if id_ in CAVS}
        for path in (folder / f"{SCENARIO}.fcd.xml", tmp_path / "replayed.xml")
    )
    inner = [key for key in sent if 2 <= key[0] <= 98]
    assert len(inner) == 2 * 97
    assert max(np.hypot(*np.subtract(sent[key], replayed[key])) for key in inner) < 1e-3
