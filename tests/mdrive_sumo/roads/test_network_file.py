"""`network.json`: what is beside the lanes, and what a network without it leaves out."""

import json

import numpy as np
import pytest
from pydantic import ValidationError

from mdrive_sumo.roads import BusStop, NetworkFile, ParkingRow

PLAIN = NetworkFile(name="a", origin="b", licence="c", offset=(0.0, 0.0), build=(), checksum="")
ROW = ParkingRow(id="row_1", line=((0.0, 1.0), (20.0, 1.0)), width_m=2.0)


def test_parts_that_a_network_lacks_are_left_out_of_the_file() -> None:
    assert {"parking", "bus_stops", "drivable_areas", "log_origin"}.isdisjoint(json.loads(PLAIN.model_dump_json()))


def test_parking_and_bus_stops_survive_the_file() -> None:
    stop = BusStop(id="stop_1", lane="east_1", line=((30.0, 0.0), (45.0, 0.0)))
    about = PLAIN.model_copy(update={"parking": (ROW,), "bus_stops": (stop,)})
    read = NetworkFile.model_validate_json(about.model_dump_json())
    assert read == about
    np.testing.assert_array_equal(read.parking[0].xy, [[0, 1], [20, 1]])
    np.testing.assert_array_equal(read.bus_stops[0].xy, [[30, 0], [45, 0]])


@pytest.mark.parametrize(
    "change", [{"width_m": 0.0}, {"line": [[0.0, 1.0]]}, {"line": [[0.0, 1.0], [float("nan"), 1.0]]}]
)
def test_a_row_without_width_or_length_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        ParkingRow.model_validate({**ROW.model_dump(), **change})
