"""Stand-ins for the classes with which V2XPnP's authors pickled their maps, under the original's module name."""

import sys
from dataclasses import make_dataclass
from enum import IntEnum
from types import ModuleType
from typing import Any

import pytest

MODULE = "opencood.data_utils.datasets.map.map_types"
FIELDS = {
    "Map": ("map_features", "dynamic_states"),
    "Lane": ("road_id", "lane_id", "type", "polyline", "entry_lanes", "exit_lanes", "boundary"),
    "MapPoint": ("x", "y", "z"),
    "Crosswalk": ("polygon", "id"),
    "RoadLine": ("id", "type", "polyline"),
    "WalkButton": ("position", "id"),
    "DynamicState": ("timestamp_seconds", "lane_states"),
    "TrafficSignalLaneState": ("lane", "state"),
}
LANE_TYPES = {"Unknown": 0, "Driving": 1, "Sidewalk": 2, "Shoulder": 3, "ParkingLane": 4}


def installed(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module with its classes, importable for the length of a test."""
    parts = MODULE.split(".")
    for count in range(1, len(parts)):
        monkeypatch.setitem(sys.modules, ".".join(parts[:count]), ModuleType(".".join(parts[:count])))
    module: Any = ModuleType(MODULE)
    for name, fields in FIELDS.items():
        made = make_dataclass(name, fields)
        made.__module__ = MODULE
        setattr(module, name, made)
    module.LaneType = IntEnum("LaneType", LANE_TYPES, module=MODULE)
    monkeypatch.setitem(sys.modules, MODULE, module)
    return module
