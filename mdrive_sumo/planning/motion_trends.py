"""How the speeds of other road users change: estimated from successive exact observations."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Float

WINDOW_S = 0.3
"""[s] Speeds so far apart are compared: SUMO's drivers dawdle by some 0.1 m/s from one step to the next."""


@dataclass(frozen=True, slots=True)
class _Sample:
    time_s: float
    speed_by_id: dict[str, float]


class AccelerationEstimator:
    """Estimates the accelerations of observed road users. Observations contain none."""

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s
        self._samples: list[_Sample] = []

    def update(self, objects: Objects, time_s: float) -> None:
        """Store the speeds at a time [s] that is later than the last one."""
        speeds = dict(zip(objects.ids, objects.speed.tolist(), strict=True))
        self._samples.append(_Sample(time_s, speeds))
        while len(self._samples) > 2 and time_s - self._samples[1].time_s >= self._window_s - 1e-6:
            self._samples.pop(0)

    def estimate(self, objects: Objects) -> Float:
        """Return the accelerations (N,) [m/s2] over the last `window_s`; 0 for those that were not observed before."""
        if not self._samples:
            return np.zeros(len(objects.ids))
        first, last = self._samples[0], self._samples[-1]
        elapsed_s = max(last.time_s - first.time_s, 1e-6)
        before = np.array([first.speed_by_id.get(name, np.nan) for name in objects.ids], dtype=np.float64)
        after = np.array([last.speed_by_id.get(name, np.nan) for name in objects.ids], dtype=np.float64)
        return np.nan_to_num((after - before) / elapsed_s)
