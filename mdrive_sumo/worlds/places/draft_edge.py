"""DraftEdge: one direction of a road with lanes of any use and width, before netconvert compiles it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from mdrive_sumo.core.geometry import Polyline

LaneUse = Literal["walk", "park", "cycle", "drive"]
PERMISSIONS: Mapping[LaneUse, str] = {
    "walk": 'allow="pedestrian"',
    "park": 'disallow="all"',
    "cycle": 'allow="bicycle"',
    "drive": 'disallow="pedestrian"',
}


@dataclass(frozen=True, slots=True)
class DraftLane:
    """A lane of an edge; no vehicle drives on one for parking."""

    use: LaneUse
    width_m: float


@dataclass(frozen=True, eq=False)
class DraftEdge:
    """A road in one direction."""

    id: str
    begin: str
    """Node where it begins."""
    end: str
    line: Polyline
    """Left edge of the leftmost lane, in driving direction."""
    lanes: tuple[DraftLane, ...]
    """From the kerb to the line, as SUMO counts them."""
    speed: float
    """Speed limit [m/s]."""
    priority: int

    @cached_property
    def car_lanes(self) -> tuple[int, ...]:
        """Indices of the lanes for cars."""
        return tuple(i for i, lane in enumerate(self.lanes) if lane.use == "drive")

    @cached_property
    def cycle_lane(self) -> int | None:
        """Index of the cycle lane."""
        return next((i for i, lane in enumerate(self.lanes) if lane.use == "cycle"), None)

    @cached_property
    def width_m(self) -> float:
        """Width of all lanes."""
        return sum(lane.width_m for lane in self.lanes)

    def find_centre(self, index: int) -> float:
        """Return the distance [m] of the centre of a lane from the line, to the right."""
        return sum(lane.width_m for lane in self.lanes[index + 1 :]) + self.lanes[index].width_m / 2

    def format_xml(self) -> str:
        """Return the edge as netconvert reads it; points have two decimals, which keeps headings of short pieces."""
        shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in self.line.xy.tolist())
        lanes = "\n".join(
            f'        <lane index="{i}" {PERMISSIONS[lane.use]} width="{lane.width_m:.4g}"/>'
            for i, lane in enumerate(self.lanes)
        )
        return (
            f'    <edge id="{self.id}" from="{self.begin}" to="{self.end}" numLanes="{len(self.lanes)}"'
            f' speed="{self.speed:.4g}" priority="{self.priority}" shape="{shape}">\n{lanes}\n    </edge>'
        )
