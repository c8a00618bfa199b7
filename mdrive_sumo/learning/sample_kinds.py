"""Kinds of samples by what the expert does next: most of a drive is waiting or cruising, and the rest decides."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

STANDS_M_S = 0.5
"""[m/s] Below it a car counts as standing."""
SHARES: Mapping[str, float] = MappingProxyType({"stand": 0.3, "cruise": 1.0, "turn": 2.0, "brake": 2.0, "start": 3.0})
"""How often a sample of a kind is drawn in training, relative to one of `cruise`."""


def name_kinds(arrays: Mapping[str, npt.NDArray[np.generic]]) -> npt.NDArray[np.str_]:
    """Return the kind (M,) of each sample, by what the expert does in the next 3 s."""
    speed, last = arrays["own"][:, 3].astype(np.float64), arrays["expert_plan"][:, -1].astype(np.float64)
    kinds = np.full(len(speed), "cruise", dtype="<U6")
    kinds[np.abs(last[:, 1]) > 2.0] = "turn"
    kinds[(speed > 2.0) & (last[:, 0] < 0.6 * 3.0 * speed) & (np.abs(last[:, 1]) <= 2.0)] = "brake"
    kinds[(speed < STANDS_M_S) & (last[:, 0] < 1.0)] = "stand"
    kinds[(speed < 1.5) & (last[:, 0] > 2.0)] = "start"
    return kinds


def compute_shares(arrays: Mapping[str, npt.NDArray[np.generic]]) -> npt.NDArray[np.float64]:
    """Return how often each sample (M,) is drawn in training."""
    return np.array([SHARES[kind] for kind in name_kinds(arrays).tolist()])
