"""TEMPORARY stand-in."""
from typing import Any


class LidarSensor:
    def __init__(self, *a: Any) -> None:
        raise NotImplementedError

    def sense(self, *a: Any) -> Any:
        raise NotImplementedError
