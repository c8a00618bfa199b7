"""Surroundings: what stands along the streets of a kind of neighbourhood, and by what rules.

Sources: BauNVO § 22 (open and closed development); building codes of the German states, § 6 (3 m from a building to
each boundary); FStrG § 9 (no building within 20 m of a federal road outside of towns); RASt 06 (widths of pavements,
sight triangles); what has no source there is chosen and says so.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from mdrive_sumo.worlds.places.street_houses import HouseRows


@dataclass(frozen=True, slots=True)
class ObstacleRow:
    """A row of things that block sight along streets."""

    kind: str
    rows: HouseRows


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What stands along the streets of a kind of neighbourhood."""

    words: str
    """For descriptions: "in a suburb"."""
    rows: tuple[ObstacleRow, ...]
    """From the most to the least important: what is drawn first keeps its room."""
    pavement_m: float
    """Width of pavements; 0: none."""
    lane_m: float
    keeps_sight: float = 1.0
    """Share of the places whose junctions without signals keep their sight triangles free."""


HEDGE = HouseRows((0.5, 0.5), (3.5, 12.0), (6.0, 18.0), (0.8, 0.8), 0.6)
"""Along the pavement, with gaps for driveways of 3.5 m or more; share and lengths chosen."""
WALL = HouseRows((0.5, 0.5), (4.0, 20.0), (4.0, 12.0), (0.3, 0.3), 0.5)
"""Along the pavement, 0.3 m thick; share and lengths chosen."""
TREES = HouseRows((0.8, 1.6), (9.0, 18.0), (0.5, 0.5), (0.5, 0.5), 0.5)
"""Trunks; RASt 06 proposes 8 to 15 m between the trees of a row."""

SURROUNDINGS: Mapping[str, Surroundings] = {
    # Closed development at the back of the pavement. The share that keeps sight triangles is chosen: old junctions
    # without signals are those with poor sight, and RASt 06, 6.3.9.3 asks for mirrors, signals or lower limits there.
    "old_town": Surroundings(
        "in an old town",
        (
            ObstacleRow("house", HouseRows((0.5, 1.2), (0.5, 2.5), (7.0, 18.0), (8.0, 13.0), 0.95)),
            ObstacleRow("wall", WALL),
        ),
        1.2,
        3.0,
        0.4,
    ),
    # Closed or half-open development with a narrow strip in front.
    "town": Surroundings(
        "in a town",
        (
            ObstacleRow("house", HouseRows((1.5, 4.0), (1.0, 7.0), (12.0, 26.0), (10.0, 14.0), 0.9)),
            ObstacleRow("tree", TREES),
        ),
        2.5,
        3.25,
    ),
    # Detached houses: 3 m to each boundary make gaps of 6 m, front gardens of 3 to 8 m behind hedges.
    "suburb": Surroundings(
        "in a suburb",
        (
            ObstacleRow("house", HouseRows((4.0, 8.0), (6.0, 12.0), (9.0, 15.0), (8.0, 11.0), 0.85)),
            ObstacleRow("hedge", HEDGE),
            ObstacleRow("tree", HouseRows((1.5, 2.8), (14.0, 30.0), (0.5, 0.5), (0.5, 0.5), 0.5)),
        ),
        2.0,
        3.25,
    ),
    # Halls behind car parks; sizes chosen.
    "commercial": Surroundings(
        "in a commercial area",
        (
            ObstacleRow("house", HouseRows((9.0, 20.0), (12.0, 35.0), (25.0, 50.0), (18.0, 35.0), 0.7)),
            ObstacleRow("tree", HouseRows((1.0, 3.0), (12.0, 24.0), (0.5, 0.5), (0.5, 0.5), 0.5)),
        ),
        2.0,
        3.5,
    ),
    # Farms and barns 20 m from the road or more; hedges and trees at field edges.
    "country": Surroundings(
        "in the country",
        (
            ObstacleRow("house", HouseRows((20.0, 32.0), (25.0, 70.0), (12.0, 30.0), (10.0, 16.0), 0.35)),
            ObstacleRow("hedge", HouseRows((3.0, 6.0), (15.0, 60.0), (12.0, 30.0), (1.5, 1.5), 0.4)),
            ObstacleRow("tree", HouseRows((4.5, 7.0), (18.0, 45.0), (0.6, 0.6), (0.6, 0.6), 0.4)),
        ),
        0.0,
        3.5,
    ),
    # Nothing stands there, as on a new estate before its houses: sight is open in all directions. Never drawn unasked.
    "open": Surroundings("on open ground", (), 2.0, 3.25),
}
"""Trees of country roads stand 4.5 m from the road or farther, as RPS 2009 asks for at 80 to 100 km/h without barriers
(its least distance; 7.5 m for new ones)."""
