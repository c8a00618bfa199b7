"""Validation of the options of a SensorSpec, when the sensor is built."""

from collections.abc import Collection

from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.errors import InputError

MAX_EVERY_TICKS = 200
"""The rarest measurements: one in 10 s."""


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


def read_choice(spec: SensorSpec, name: str, default: str, known: Collection[str]) -> str:
    """Return the option as one of the known names. Raises InputError."""
    value = spec.options.get(name, default)
    if not isinstance(value, str) or value not in known:
        raise InputError(f"sensor {spec.kind!r}: option {name!r}: expected one of {', '.join(known)}, found {value!r}")
    return value
