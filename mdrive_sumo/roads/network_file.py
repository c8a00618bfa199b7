"""`network.json`: facts about a network that the compiled SUMO net does not contain."""

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import shapely
from pydantic import BaseModel, ConfigDict, Field, SerializerFunctionWrapHandler, ValidationError, model_serializer

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.input_files import read_bytes

NET_FILE = "map.net.xml.gz"
NETWORK_FILE = "network.json"
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
WideCoordinate = Annotated[float, Field(ge=-1e8, le=1e8, allow_inf_nan=False)]
"""Of a log's own frame, which may be that of a map projection."""
Ring = Annotated[tuple[tuple[WideCoordinate, WideCoordinate], ...], Field(min_length=3)]
"""Corners [m] of a closed line; the last differs from the first."""
OpenLine = Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=2)]
"""Points [m] of a line, in the direction in which vehicles stand on it."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Building(_Part):
    """A simple polygon [m] that blocks sight and stops cars."""

    id: str
    polygon: tuple[tuple[Coordinate, Coordinate], ...] = Field(min_length=3)

    @property
    def outline(self) -> Float:
        """Corners (N, 2) [m]."""
        return np.array(self.polygon)


class DrivableArea(_Part):
    """Asphalt beyond the lanes [m]: parking lanes, car parks, driveways. Only pictures show it; no sensor reads it."""

    outline: Ring
    holes: tuple[Ring, ...] = ()

    @property
    def polygon(self) -> shapely.Polygon:
        """The area as a polygon with holes."""
        return shapely.Polygon(self.outline, self.holes)


class ParkingRow(_Part):
    """Where vehicles park: one behind the other along a street, or alone in a stall of a car park."""

    id: str
    line: OpenLine
    """Centre line of the row or stall."""
    width_m: float = Field(gt=0, le=10)

    @property
    def xy(self) -> Float:
        """Points (N, 2) [m] of the centre line."""
        return np.array(self.line)


class BusStop(_Part):
    """Where a bus stops: on `lane`, between both ends of the line."""

    id: str
    lane: str
    line: OpenLine

    @property
    def xy(self) -> Float:
        """Points (N, 2) [m] of the centre line."""
        return np.array(self.line)


class StopSignBox(_Part):
    """A stop sign. Its line lies at `line_pos_m` on `lane`; its box is the lane's width times `length_m` before it."""

    id: str
    lane: str
    line_pos_m: float = Field(ge=0)
    length_m: float = Field(gt=0)


class YieldSign(_Part):
    """A yield sign. Its line lies at `line_pos_m` on `lane`."""

    id: str
    lane: str
    line_pos_m: float = Field(ge=0)


class NetworkFile(_Part):
    """Origin and additions of a network, in the network's own frame."""

    format: Literal["mdrive-sumo/network/1"] = "mdrive-sumo/network/1"
    name: str
    description: str = ""
    origin: str
    licence: str
    offset: tuple[float, float]
    """netOffset of the compiled net: source coordinates + offset = network coordinates."""
    log_origin: tuple[float, float] | None = None
    """Of a converted log that was shifted: its origin in the frame of the log [m]. Exports add it."""
    build: tuple[str, ...]
    """Arguments of the netconvert call that made the net, run in this folder."""
    checksum: str
    """SHA-256 of the uncompressed net file."""
    buildings: tuple[Building, ...] = ()
    stop_signs: tuple[StopSignBox, ...] | None = None
    """None: unknown (the report says 'signs unknown'); (): there are none."""
    drivable_areas: tuple[DrivableArea, ...] = ()
    """Of converted logs, from the HD map and from where the log's vehicles drive and park; for pictures."""
    parking: tuple[ParkingRow, ...] = ()
    """Of drawn places: where parked vehicles may stand."""
    bus_stops: tuple[BusStop, ...] = ()
    yield_signs: tuple[YieldSign, ...] = ()
    """Of drawn places. They tell what the junction's rules in the net are; simulations read those."""

    @model_serializer(mode="wrap")
    def _omit_missing_parts(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out origin and parts of which there are none: networks without them keep their checksums."""
        plain: dict[str, Any] = serialize(self)
        optional = ("drivable_areas", "log_origin", "parking", "bus_stops", "yield_signs")
        return {key: value for key, value in plain.items() if key not in optional or getattr(self, key)}


def read_network_file(folder: Path) -> NetworkFile:
    """Read `network.json` of a network folder. Raises InputError."""
    path = folder / NETWORK_FILE
    try:
        return NetworkFile.model_validate_json(read_bytes(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in problem["loc"]) or "the file"
        raise InputError(f"{path}: {where}: {problem['msg']}") from None


def compute_net_checksum(net_xml: bytes) -> str:
    """Return the checksum of an uncompressed net file."""
    return "sha256:" + hashlib.sha256(net_xml).hexdigest()
