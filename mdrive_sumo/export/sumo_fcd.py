"""FCD: floating car data as SUMO writes it with `--fcd-output`, with the vehicle types and the network beside it.

SUMO's conventions: the position is the centre of the front bumper, angles are degrees clockwise from north.
Source: https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.output_files import copy_file, write_text
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.export.lane_assignment import NO_LANE, assign_lanes
from mdrive_sumo.export.scored_recording import ScoredRecording

TAG_BY_KIND = {Kind.PEDESTRIAN: "person"}
"""All other kinds, props included, are vehicles: SUMO has no other moving boxes."""
CLASS_BY_CATEGORY = {
    "car": "passenger",
    "van": "delivery",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "static": "ignoring",
}
"""vClass of SUMO by category; `ignoring` may be anywhere."""


def write_fcd(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write SCENARIO.fcd.xml and SCENARIO.types.xml per recording, and each network once."""
    for recording in recordings:
        name = recording.name
        write_text(folder / f"{name}.fcd.xml", "\n".join(_format_steps(recording)) + "\n")
        write_text(folder / f"{name}.types.xml", "\n".join(_format_types(recording)) + "\n")
        network = folder / f"{recording.scenario.network}.net.xml.gz"
        if not network.exists():
            copy_file(recording.roads.net_file, network)


def _format_steps(recording: ScoredRecording) -> Iterator[str]:
    record = recording.record
    front_x, front_y = recording.shift_ahead(record.length / 2)
    angle = np.degrees(math.pi / 2 - record.yaw) % 360.0
    lanes = _format_lanes(recording, front_x, front_y)
    tags = [TAG_BY_KIND.get(Kind(int(kind)), "vehicle") for kind in recording.record.kind]
    vehicles_first = sorted(range(len(tags)), key=lambda n: tags[n] != "vehicle")  # the schema asks for this order
    heads = [
        f"<{tag} id={quoteattr(id_)} type={quoteattr(type_)}"
        for tag, id_, type_ in zip(tags, record.ids, _name_types(recording), strict=True)
    ]
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield "<fcd-export>"
    for tick in range(record.ticks):
        yield f'    <timestep time="{tick * DT:.2f}">'
        for n in (n for n in vehicles_first if record.valid[tick, n]):
            yield (
                f'        {heads[n]} x="{front_x[tick, n]:.4f}" y="{front_y[tick, n]:.4f}"'
                f' angle="{angle[tick, n]:.3f}" speed="{record.speed[tick, n]:.3f}"{lanes[tick][n]}/>'
            )
        yield "    </timestep>"
    yield "</fcd-export>"


def _format_lanes(recording: ScoredRecording, x: Float, y: Float) -> list[list[str]]:
    """Return the attributes `lane` and `pos` per tick and column; "" off the road."""
    lanes, positions = assign_lanes(recording, x, y)
    heads = [f" lane={quoteattr(lane.id)} pos=" for lane in recording.roads.driving]
    return [
        ["" if lane == NO_LANE else f'{heads[lane]}"{position:.2f}"' for lane, position in zip(*row, strict=True)]
        for row in zip(lanes.tolist(), positions.tolist(), strict=True)
    ]


def _name_types(recording: ScoredRecording) -> Sequence[str]:
    """Return the vehicle type of every column: its category and size."""
    record = recording.record
    sizes = zip(recording.categories, record.length, record.width, strict=True)
    return [f"{category}_{length:g}x{width:g}" for category, length, width in sizes]


def _format_types(recording: ScoredRecording) -> Iterator[str]:
    record, heights = recording.record, recording.heights
    columns = {name: n for n, name in reversed(list(enumerate(_name_types(recording))))}
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield "<additional>"
    for name, n in sorted(columns.items()):
        yield (
            f'    <vType id={quoteattr(name)} vClass="{CLASS_BY_CATEGORY[recording.categories[n]]}"'
            f' length="{record.length[n]:g}" width="{record.width[n]:g}" height="{heights[n]:g}"/>'
        )
    yield "</additional>"
