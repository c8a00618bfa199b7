"""Place the labels of a picture so that none covers another one."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

RINGS = 12
"""Distances at which places are tried, one label height apart."""


@dataclass(frozen=True, slots=True)
class LabelBox:
    """A rectangle with its middle and its full size, in any unit; y is up."""

    x: float
    y: float
    width: float
    height: float

    def overlaps(self, other: "LabelBox") -> bool:
        """Return whether the rectangles share an area."""
        return (
            2 * abs(self.x - other.x) < self.width + other.width
            and 2 * abs(self.y - other.y) < self.height + other.height
        )


@dataclass(frozen=True, slots=True)
class LabelRequest:
    """A label of a size for a thing at (x, y), whose middle stays `clearance` away from the label's edge."""

    x: float
    y: float
    width: float
    height: float
    clearance: float


def place_labels(requests: Sequence[LabelRequest], taken: Sequence[LabelBox] = ()) -> list[LabelBox]:
    """Return a box for every label, as near to its thing as the boxes before it and `taken` leave room.

    Beyond `RINGS` label heights a label goes on upwards, so every label gets a place.
    """
    boxes: list[LabelBox] = list(taken)
    for request in requests:
        boxes.append(next(box for box in _list_places(request) if not any(box.overlaps(other) for other in boxes)))
    return boxes[len(taken) :]


def _list_places(request: LabelRequest) -> Iterator[LabelBox]:
    """Yield boxes above, below, right and left of the thing and at its corners, farther and farther away."""
    for ring in count():
        up = request.clearance + (ring + 0.5) * request.height
        aside = request.clearance + request.width / 2 + ring * request.height
        sides = ((0, up), (0, -up), (aside, 0), (-aside, 0), (aside, up), (-aside, up), (aside, -up), (-aside, -up))
        for x, y in sides if ring < RINGS else sides[:1]:
            yield LabelBox(request.x + x, request.y + y, request.width, request.height)
