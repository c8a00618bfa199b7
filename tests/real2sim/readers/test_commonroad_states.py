"""CommonRoad: positions that are areas, orientations that are intervals."""

import math

import numpy as np
import pytest
from testing.commonroad_samples import MOVES, Write, format_lanelet, format_obstacle

from real2sim.readers.commonroad import read_commonroad

AREAS = {
    "rectangle": "<rectangle><length>2</length><width>1</width><orientation>1</orientation>"
    "<center><x>13</x><y>2</y></center></rectangle>",
    "circle": "<circle><radius>1</radius><center><x>13</x><y>2</y></center></circle>",
    "two": "<circle><radius>1</radius><center><x>12</x><y>2</y></center></circle>"
    "<circle><radius>1</radius><center><x>14</x><y>2</y></center></circle>",
    "polygon": "<polygon>"
    + "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in ((12, 1), (14, 1), (14, 3), (12, 3)))
    + "</polygon>",
}


@pytest.mark.parametrize("area", AREAS)
def test_the_centre_of_a_position_that_is_an_area_is_taken(write: Write, area: str) -> None:
    vague = MOVES.replace("<point><x>13</x><y>0</y></point>", AREAS[area])
    recording = read_commonroad(write(format_lanelet(1, 0), format_obstacle(7, vague)))
    (track,) = recording.views[0].tracks
    np.testing.assert_allclose(track.xy, [(10, 0), (11, 0), (np.nan, np.nan), (13, 2)])
    assert recording.notes == ("1 obstacles whose positions are areas: their centres taken",)


@pytest.mark.parametrize(("start", "end", "yaw"), [(0.4, 0.6, 0.5), (3.0, 3.4, 3.2), (-3.1, 3.1, math.nan)])
def test_the_middle_of_a_narrow_interval_of_headings_is_taken(
    write: Write, start: float, end: float, yaw: float
) -> None:
    interval = f"<intervalStart>{start}</intervalStart><intervalEnd>{end}</intervalEnd>"
    vague = MOVES.replace("<exact>0.5</exact>", interval)
    recording = read_commonroad(write(format_lanelet(1, 0), format_obstacle(7, vague)))
    (track,) = recording.views[0].tracks
    np.testing.assert_allclose(np.exp(1j * track.yaw[track.valid]), np.exp(1j * np.full(3, yaw)))
    np.testing.assert_array_equal(track.x, [10, 11, np.nan, 13])
    assert recording.notes == (
        "1 obstacles whose orientations are intervals: their middles taken, none of intervals over 90 degrees",
    )
