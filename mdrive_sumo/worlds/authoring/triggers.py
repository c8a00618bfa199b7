"""Triggers of scripted road users: when one that waits sets off, or one that drives brakes or changes its lane."""

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scenario.scripted_actor import DistanceTrigger, PositionTrigger, TimeTrigger


def near(cav: str, distance_m: float = 20.0) -> DistanceTrigger:
    """Fire when a CAV is within a distance [m], from centre to centre; 1 to 50 m. Raises InputError."""
    try:
        return DistanceTrigger(vehicle=cav, distance_m=distance_m)
    except ValidationError as error:
        raise InputError(f"near({cav!r}, {distance_m!r}): {describe_first_error(error)}") from None


def after(seconds: float) -> TimeTrigger:
    """Fire that many seconds after the start. Raises InputError."""
    try:
        return TimeTrigger(at_s=seconds)
    except ValidationError as error:
        raise InputError(f"after({seconds!r}): {describe_first_error(error)}") from None


def when_at(cav: str, point: tuple[float, float], radius_m: float = 3.0) -> PositionTrigger:
    """Fire when the centre of a CAV is within a circle around a point (x, y) [m]. Raises InputError."""
    try:
        return PositionTrigger(vehicle=cav, x=point[0], y=point[1], radius_m=radius_m)
    except (ValidationError, IndexError, TypeError) as error:
        is_value = isinstance(error, ValidationError)
        reason = describe_first_error(error) if is_value else "expected a point (x, y) in metres"
        raise InputError(f"when_at({cav!r}, {point!r}): {reason}") from None
