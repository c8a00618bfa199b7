"""The contract as data, for `mdrive-sumo schema contract`."""

from dataclasses import fields, is_dataclass
from typing import Any, Literal, get_type_hints

import numpy as np

from mdrive_sumo.contract.briefing import Briefing
from mdrive_sumo.contract.exchange import Observation, Reply
from mdrive_sumo.contract.reply_check import CONTROL_STEP
from mdrive_sumo.contract.sensors import SensorSpec

CONTRACT = "mdrive-sumo/contract/3"
CROSSING: tuple[type, ...] = (SensorSpec, Briefing, Observation, Reply)


def schema() -> dict[str, Any]:
    """Return the contract as data: every dataclass exchanged with an agent, with its fields and their types."""
    described: dict[str, Any] = {}
    queue: list[type] = list(CROSSING)
    while queue:
        cls = queue.pop(0)
        if cls.__name__ in described:
            continue
        hints = get_type_hints(cls)
        described[cls.__name__] = {
            "description": (cls.__doc__ or "").strip(),
            "fields": {f.name: _type_name(hints[f.name], queue) for f in fields(cls)},
        }
    return {"format": CONTRACT, "control_step": CONTROL_STEP, "types": described}


def _type_name(hint: Any, queue: list[type]) -> str:
    if isinstance(hint, type) and is_dataclass(hint):
        queue.append(hint)
        return hint.__name__
    arguments: tuple[Any, ...] = getattr(hint, "__args__", ())
    if getattr(hint, "__origin__", None) is np.ndarray:
        return f"array[{arguments[1].__args__[0].__name__}]"
    if getattr(hint, "__origin__", None) is Literal:
        return " | ".join(f'"{value}"' for value in arguments)
    if arguments:
        names = [_type_name(a, queue) for a in arguments if a is not Ellipsis]
        origin = getattr(hint, "__origin__", None)
        return " | ".join(names) if origin is None else f"{origin.__name__}[{', '.join(names)}]"
    return "null" if hint is type(None) else getattr(hint, "__name__", str(hint))
