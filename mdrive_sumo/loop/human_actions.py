"""What happens in the car of a person: its driver, pedals and wheel, texts; live, or read from the recording of a take.

Controls, texts and notes of a recording are the log of actions: `RecordedActions` reads them back. A driver is a note
of kind `DRIVER` in the tick in which that begins, e.g. {"driver":"human","device":"wheel"} or
{"driver":"sharing","config":{}}. A recording may be a stranger's, so every part of it is checked.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

from mdrive_sumo.contract import CONTROL_STEP, DRIVER, REMARK, Control, Message, Note
from mdrive_sumo.contract.human_options import DEVICES, HUMAN
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT, FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.v2x.messages import MAX_TEXT_BYTES

RECORDING = "recording"
"""Driver: what a recording holds, tick by tick; the begin of a take that enters a run whose agent is not built in."""
MAX_TEXTS = 8
"""Texts that a person sends in one tick: more than a person types in 50 ms."""
MAX_OPTIONS_LENGTH = 2000
"""Characters of a driver note."""
LIMITS: Mapping[str, float] = {"throttle": 0.0, "brake": 0.0, "steer": -1.0}
"""Least value of each part of a control; the largest is 1."""


@dataclass(frozen=True, slots=True)
class DriverChoice:
    """The driver from a tick on: a person (`HUMAN`), `RECORDING`, or a built-in agent that starts afresh."""

    name: str
    config: Mapping[str, float | str | bool] = field(default_factory=dict[str, float | str | bool])
    """Options of the agent; of a person the `device`, one of `agents.human.DEVICES`."""

    def __post_init__(self) -> None:
        """Raises InputError for an unknown device. Whether an agent may drive is known to `HumanDriver`."""
        if self.name == HUMAN and (set(self.config) - {"device"} or self.device not in DEVICES):
            raise InputError(
                f"driver human: expected a device among {', '.join(DEVICES)}, found {dict(self.config)!r:.80}"
            )

    @property
    def device(self) -> object:
        """The input device of a person."""
        return self.config.get("device", DEVICES[0])

    def to_note(self) -> Note:
        """Return the note with which it begins."""
        options = {"device": self.device} if self.name == HUMAN else {"config": dict(self.config)}
        content = {"driver": self.name, **(options if self.name != RECORDING else {})}
        return Note(DRIVER, json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False))

    @classmethod
    def from_note(cls, note: Note) -> Self:
        """Return the driver of a note. Raises InputError for anything else."""
        content = _parse_object(note.text)
        name, config = content.get("driver"), content.get("config", {})
        if "device" in content:
            config = {"device": content["device"]}
        is_sound = (
            isinstance(name, str)
            and {*content} <= {"driver", "config", "device"}
            and isinstance(config, dict)
            and all(isinstance(value, str | int | float) for value in config.values())
        )
        if not is_sound:
            raise InputError(
                'expected a driver, e.g. {"driver":"human","device":"wheel"} or {"driver":"sharing","config":{}}, found'
                f" {note.text!r:.100}"
            )
        return cls(str(name), config)


def _parse_object(text: str) -> dict[str, Any]:
    """Return the JSON object of a note; an empty one for anything else."""
    try:
        content = json.loads(text) if len(text) <= MAX_OPTIONS_LENGTH else None
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


@dataclass(frozen=True, slots=True)
class Action:
    """What happens in a car in one tick."""

    driver: DriverChoice | None = None
    """The driver from this tick on; None: as before. The action of the first tick names one."""
    control: Control | None = None
    """Pedals and wheel, while a person or a recording drives; None: as in the last tick, or rolling."""
    texts: tuple[str, ...] = ()
    """What the person says to all others."""
    notes: tuple[Note, ...] = ()
    """For the recording: of kind `REMARK`; of a recording any kind but `DRIVER`."""
    messages: tuple[Message, ...] = ()
    """While a recording drives, what it sends."""

    def __post_init__(self) -> None:
        """Raises InputError for values that no person can give: NaN, too long a text."""
        if self.control is not None:
            check_control(self.control)
        if len(self.texts) > MAX_TEXTS:
            raise InputError(f"texts: expected at most {MAX_TEXTS} in a tick, found {len(self.texts)}")
        for text in self.texts:
            check_text(text)


def check_control(control: Control) -> None:
    """Raise InputError unless pedals and wheel are in their ranges. NaN is in none."""
    for name, least in LIMITS.items():
        value = getattr(control, name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= 1.0:
            raise InputError(f"{name}: expected a number in [{least:g}, 1], found {value!r:.40}")


def check_text(text: str) -> None:
    """Raise InputError for a text that the channel does not carry."""
    try:
        size = len(text.encode())
    except UnicodeEncodeError:
        raise InputError("text: expected Unicode text, found a lone surrogate") from None
    if size > MAX_TEXT_BYTES:
        raise InputError(f"text: expected at most {MAX_TEXT_BYTES} bytes, found {size}")


class ActionSource(Protocol):
    """Where the actions in one car come from: devices, or a recording."""

    def read(self, tick: int) -> Action:
        """Return what happens in the tick; called once for every tick, in order.

        Raises AgentFailure, of `make_leaving` if the person has left.
        """
        ...


def make_leaving(tick: int) -> AgentFailure:
    """Return the failure of a CAV whose person leaves in a tick."""
    return AgentFailure(FailureReason.LEFT, f"the person left at tick {tick} ({tick * DT:.2f} s)")


def make_control(steps: tuple[int, int, int]) -> Control:
    """Return the control of a recording, in multiples of `CONTROL_STEP`, as it was applied. Raises InputError."""
    control = Control(*(round(step * CONTROL_STEP, 4) for step in steps))
    check_control(control)
    return control


def is_remark(note: Note) -> bool:
    """Return whether a note is of the kind that people leave."""
    return note.kind == REMARK
