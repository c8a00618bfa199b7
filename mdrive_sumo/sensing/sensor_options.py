"""Validation of the options of a SensorSpec, when the sensor is built."""

from collections.abc import Collection
from dataclasses import dataclass

from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.errors import InputError

MAX_EVERY_TICKS = 200
"""The rarest measurements: one in 10 s."""
MAX_CYCLE_TICKS = 20_000
"""The longest cycle: 1000 s, more than any episode."""
TICK_OPTIONS = ("every_ticks", "on_ticks", "cycle_ticks", "cycle_start")
"""Options that `read_measuring_ticks` reads."""


@dataclass(frozen=True, slots=True)
class MeasuringTicks:
    """The ticks in which a sensor measures: every n-th, of those in the first `on` of each cycle."""

    every: int = 1
    on: int = 1
    cycle: int = 1
    start: int = 0
    """Tick at which a cycle begins."""

    def is_due(self, tick: int) -> bool:
        """Return whether the sensor measures in a tick."""
        return tick % self.every == 0 and (tick - self.start) % self.cycle < self.on


def check_option_names(spec: SensorSpec, known: Collection[str]) -> None:
    """Raise InputError for an option that this kind of sensor does not have."""
    for name in spec.options:
        if name not in known:
            expected = f"one of {', '.join(sorted(known))}" if known else "no options"
            raise InputError(f"sensor {spec.kind!r}: expected {expected}, found option {name!r}")


def read_number(spec: SensorSpec, name: str, default: float, low: float, high: float) -> float:
    """Return the option as a number in [low, high]. Raises InputError."""
    value = spec.options.get(name, default)
    if isinstance(value, bool | str) or not low <= value <= high:  # NaN fails too
        raise InputError(
            f"sensor {spec.kind!r}: option {name!r}: expected a number in [{low:g}, {high:g}], found {value!r}"
        )
    return float(value)


def read_whole(spec: SensorSpec, name: str, default: int, low: int, high: int) -> int:
    """Return the option as a whole number in [low, high]. Raises InputError."""
    value = read_number(spec, name, default, low, high)
    if not value.is_integer():
        raise InputError(f"sensor {spec.kind!r}: option {name!r}: expected a whole number, found {value}")
    return int(value)


def read_measuring_ticks(spec: SensorSpec) -> MeasuringTicks:
    """Return when a sensor measures, of its options `TICK_OPTIONS`. Raises InputError."""
    every = read_whole(spec, "every_ticks", 1, 1, MAX_EVERY_TICKS)
    cycle = read_whole(spec, "cycle_ticks", 1, 1, MAX_CYCLE_TICKS)
    on = read_whole(spec, "on_ticks", cycle, 1, cycle)
    return MeasuringTicks(every, on, cycle, read_whole(spec, "cycle_start", 0, 0, MAX_CYCLE_TICKS))


def read_choice(spec: SensorSpec, name: str, default: str, known: Collection[str]) -> str:
    """Return the option as one of the known names. Raises InputError."""
    value = spec.options.get(name, default)
    if not isinstance(value, str) or value not in known:
        raise InputError(f"sensor {spec.kind!r}: option {name!r}: expected one of {', '.join(known)}, found {value!r}")
    return value
