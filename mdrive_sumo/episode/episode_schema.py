"""The published format of a recording: the types of its JSON header and the table of its arrays.

`mdrive-sumo schema episode` prints both. `episode_file` writes the header as `EpisodeHeader` and exactly these arrays.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.state import End, FailureReason, Kind
from mdrive_sumo.v2x.channel import DeliveryStatus
from mdrive_sumo.v2x.radio.path_loss import LinkClass

FORMAT = "mdrive-sumo/episode/3"


class ContactEntry(NamedTuple):
    """A CAV touches something in a tick. `other`: id of a CAV or an actor, "" for a building; `kind`: as in `kind`."""

    tick: int
    ego: str
    other: str
    kind: int


class SignalEntry(NamedTuple):
    """From `tick` on the traffic light `light` shows `state` (SUMO letters, one per link)."""

    tick: int
    light: str
    state: str


class PlanEntry(NamedTuple):
    """A plan of a CAV: `points` rows of `plan_points`, `interval_s` seconds apart."""

    tick: int
    ego: str
    interval_s: float
    points: int


class MessageEntry(NamedTuple):
    """A sent V2X message: its payload is the next `size` bytes of `payloads`."""

    sender: str
    tick: int
    type: str
    size: int


class NoteEntry(NamedTuple):
    """A note that an agent left in a tick."""

    tick: int
    ego: str
    kind: str
    text: str


class ThinkTimeEntry(NamedTuple):
    """The reply to the observation of `tick` took effect `ticks` later (measured clock only)."""

    ego: str
    tick: int
    ticks: int


class EndingEntry(BaseModel):
    """The end of a CAV. The fields behind `end` belong to "agent-failed": the agent failed in `failed_tick`."""

    model_config = ConfigDict(extra="forbid")

    ego: str
    tick: int
    end: End
    failure: FailureReason | None
    text: str
    failed_tick: int | None


class EpisodeHeader(BaseModel):
    """The JSON text in the array `header`."""

    model_config = ConfigDict(use_attribute_docstrings=True, extra="forbid")

    format: Literal["mdrive-sumo/episode/3"]
    scenario: str
    """Scenario id."""
    about: dict[str, Any]
    """Scalars that identify the run: agent, seed, comm, ..."""
    ids: list[str]
    """Ids of the N columns: the CAVs in the order of the scenario file, then the actors as they first appear."""
    egos: int
    """E, the number of CAVs."""
    contacts: list[ContactEntry]
    signals: list[SignalEntry]
    endings: list[EndingEntry]
    """One entry per CAV, in the order of the scenario file."""
    plans: list[PlanEntry]
    messages: list[MessageEntry]
    receivers: list[str]
    """Ids that the second column of `fates` refers to, sorted."""
    stations: list[str] = []
    """Ids that the second column of `busy_ratios` refers to, sorted; empty unless the channel was a radio."""
    notes: list[NoteEntry]
    dropped_notes: int = 0
    """Notes beyond the limits of an episode, which are not in the file."""
    dropped_payloads: list[str] = []
    """Types of messages of which `payloads` has zeros instead of the valid ones (`--no-record-features`), sorted."""
    thinking: list[ThinkTimeEntry]
    pseudonyms: dict[str, str]
    """Id of a CAV or RSU by the id that agents knew it by, which payloads and notes contain; empty if they agree."""


@dataclass(frozen=True)
class ArrayFormat:
    """One array of the archive. `shape` is in the symbols of `DIMENSIONS`."""

    dtype: tuple[str, ...]
    """The types that occur; of several the writer takes the narrowest that holds all values."""
    shape: tuple[str | int, ...]
    unit: str
    description: str


DIMENSIONS: Mapping[str, str] = MappingProxyType(
    {
        "H": "bytes of the header",
        "T": "recorded ticks (20 per second, the first is tick 0)",
        "T8": "ceil(T / 8)",
        "N": "columns: CAVs and actors",
        "E": "CAVs",
        "P": "points of all plans",
        "B": "payload bytes of all messages",
        "F": "deliveries: pairs of a message and a receiver",
        "F0": "F; 0 unless the channel was a radio",
        "L": "measurements of the load of the channel; 0 unless it was a radio",
    }
)
_NARROWEST = ("int8", "int16", "int32")
_KINDS = ", ".join(f"{kind.value} {kind.name.lower()}" for kind in Kind)
NO_LINK = -1
"""Class of the link of a message that the radio did not take."""
_LINKS = f"{NO_LINK} none, " + ", ".join(f"{kind.value} {kind.name}" for kind in LinkClass)
_FATES = ", ".join(f"{i} {fate}" for i, fate in enumerate(DeliveryStatus))

OF_RADIO = frozenset({"links", "busy_ratios"})
"""The arrays of a radio: recordings of other channels lack them."""
ARRAYS: Mapping[str, ArrayFormat] = MappingProxyType(
    {
        "header": ArrayFormat(("uint8",), ("H",), "", "UTF-8 JSON, see the property `header`"),
        "kind": ArrayFormat(("uint8",), ("N",), "", _KINDS),
        "length": ArrayFormat(("float64",), ("N",), "m", "length of the box"),
        "width": ArrayFormat(("float64",), ("N",), "m", "width of the box"),
        "valid": ArrayFormat(
            ("uint8",), ("T8", "N"), "", "whether a column is in the world, (T, N) bits packed along axis 0 (packbits)"
        ),
        "quanta": ArrayFormat(
            _NARROWEST,
            ("T", "N", 4),
            "1 mm, 1 mm, 0.1 mrad, 1 mm/s",
            "box centre x, y, yaw (counter-clockwise from +x) and speed along yaw; second differences along axis 0,"
            " a column that is absent holds its last value (before its first tick 0)",
        ),
        "controls": ArrayFormat(
            _NARROWEST,
            ("T", "E", 3),
            "1e-4",
            "throttle, brake and steer applied after the tick; first differences along axis 0",
        ),
        "plan_points": ArrayFormat(
            _NARROWEST, ("P", 2), "1 cm", "x, y of the points of all plans; first differences within each plan"
        ),
        "payloads": ArrayFormat(("uint8",), ("B",), "", "payloads of all messages, one after another"),
        "fates": ArrayFormat(
            ("int32",),
            ("F", 4),
            "",
            "delivery of the messages: index in `messages`, index in `receivers`, delivery"
            f" ({_FATES}), tick; first differences along axis 0",
        ),
        "links": ArrayFormat(
            ("int16",),
            ("F0", 2),
            "1, 1 dBm",
            f"radio link of each delivery when its message was sent: class ({_LINKS}), received power;"
            " absent unless the channel was a radio",
        ),
        "busy_ratios": ArrayFormat(
            ("int32",),
            ("L", 3),
            "1 tick, 1, 0.001",
            "share of the time that the channel was busy: tick, index in `stations`, ratio; first differences along"
            " axis 0; absent unless the channel was a radio",
        ),
        "digests": ArrayFormat(("uint8",), ("T", 8), "", "chained BLAKE2b digest after each tick"),
    }
)


def build_episode_schema() -> dict[str, Any]:
    """Return the format of a recording: JSON Schema of the header, and dtype, shape and unit of every array."""
    header = EpisodeHeader.model_json_schema()
    definitions = header.pop("$defs")
    arrays = {
        name: asdict(array) | {"dtype": list(array.dtype), "shape": list(array.shape)} for name, array in ARRAYS.items()
    }
    return {
        "title": "EpisodeFile",
        "description": f"A recording ({FORMAT}): one NumPy archive (.npz, no pickles) with these arrays.",
        "dimensions": dict(DIMENSIONS),
        "arrays": arrays,
        "header": header,
        "$defs": definitions,
    }
