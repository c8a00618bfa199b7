"""Spaces of observations and actions, and actions on their way into the arrays, checked."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.rl.driving_actions import CHOICES, CONTROL_WIDTH
from mdrive_sumo.rl.env_settings import EnvSettings
from mdrive_sumo.rl.episode_stepper import describe_shape
from mdrive_sumo.rl.observation_vector import FARTHEST
from mdrive_sumo.rl.slot_arrays import SlotArrays

CONTROL, MESSAGE = "control", "message"
"""Keys of an action that talks."""
VECTOR, GRID = "vector", "grid"
"""Keys of an observation with a grid."""
AnyObservation = np.ndarray | dict[str, np.ndarray]
"""A vector, or a dictionary of vector and grid."""


def make_observation_space(settings: EnvSettings) -> spaces.Space[Any]:
    """Return the space of one CAV's observation: its vector (numbers,), or a dictionary of vector and grid."""
    shape = describe_shape(settings, 1)
    vector = spaces.Box(-FARTHEST, FARTHEST, (shape.observation,), np.float32)
    if not settings.grid:
        return vector
    return spaces.Dict({VECTOR: vector, GRID: spaces.Box(0, 255, shape.grid, np.uint8)})


def join_observation(vector: np.ndarray, grid: np.ndarray) -> AnyObservation:
    """Return an observation, or a batch of them, of its two parts; a grid without cells is left out."""
    return {VECTOR: vector, GRID: grid} if grid.size else vector


def make_action_space(settings: EnvSettings) -> spaces.Space[Any]:
    """Return the space of one CAV's action: the control, or a dictionary of control and message (bytes,)."""
    control: spaces.Space[Any]
    if settings.control in CHOICES:
        control = spaces.Discrete(CHOICES[settings.control])
    else:
        control = spaces.Box(-1.0, 1.0, (CONTROL_WIDTH[settings.control],), np.float32)
    if not settings.message_bytes:
        return control
    message = spaces.MultiDiscrete([256] * settings.message_bytes)
    return spaces.Dict({CONTROL: control, MESSAGE: message})


def write_action(settings: EnvSettings, action: Any, slot: int, arrays: SlotArrays, agent: str) -> None:
    """Put an action into its slot. Raises InputError for one that is not in its space."""
    place = f"step: action of {agent}"
    control = action
    if settings.message_bytes:
        if not isinstance(action, Mapping) or set(action) != {CONTROL, MESSAGE}:
            raise InputError(f"{place}: expected a dictionary with {CONTROL} and {MESSAGE}, found {_describe(action)}")
        control = action[CONTROL]
        arrays.messages[slot] = _read_message(action[MESSAGE], settings.message_bytes, place)
    arrays.controls[slot] = _read_control(control, settings.control, place)
    arrays.asked[slot] = 1


def _read_control(control: Any, kind: str, place: str) -> np.ndarray:
    numbers = _read_numbers(control, place)
    if kind in CHOICES:
        if numbers.size != 1 or numbers.item() not in range(CHOICES[kind]):
            raise InputError(f"{place}: expected one of {kind} 0 to {CHOICES[kind] - 1}, found {_describe(control)}")
        return numbers.reshape(1)
    width = CONTROL_WIDTH[kind]
    if numbers.shape != (width,):
        raise InputError(f"{place}: expected an array of shape ({width},), found {_describe(control)}")
    if not (np.abs(numbers) <= 1.0).all():  # NaN fails too
        raise InputError(f"{place}: expected numbers in [-1, 1], found {numbers.tolist()}")
    return numbers


def _read_message(message: Any, length: int, place: str) -> np.ndarray:
    if isinstance(message, bytes):
        numbers = np.frombuffer(message, dtype=np.uint8).astype(np.float64)
    else:
        numbers = _read_numbers(message, f"{place}: message")
    if numbers.shape != (length,):
        raise InputError(f"{place}: message: expected {length} bytes, found {_describe(message)}")
    if not ((numbers >= 0) & (numbers <= 255) & (numbers == np.floor(numbers))).all():
        raise InputError(f"{place}: message: expected whole numbers from 0 to 255, found {numbers.tolist()}")
    return numbers


def _read_numbers(value: Any, place: str) -> np.ndarray:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{place}: expected numbers, found {_describe(value)}") from None


def _describe(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    return f"{value!r:.60}"
