"""Open-loop metrics: how far plans lie from the expert's, against driving on at constant velocity, by kind of sample.

Most of a drive is waiting or cruising; what the expert does next tells the samples that decide.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S, PLAN_POINTS

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


HORIZONS_S = (1.0, 2.0, 3.0)
"""[s] Horizons of the tables of UniAD and VAD; a plan is 3 s long."""
Float = npt.NDArray[np.float32]


def predict_constant_velocity(own: Float) -> Float:
    """Return plans (M, PLAN_POINTS, 2) straight ahead at the present speed of states (M, 6)."""
    times = PLAN_INTERVAL_S * np.arange(1, PLAN_POINTS + 1, dtype=np.float32)
    ahead = own[:, 3, None] * times
    return np.stack((ahead, np.zeros_like(ahead)), axis=-1).astype(np.float32)


def measure_plans(plans: Float, expert: Float) -> dict[str, float]:
    """Return ADE and FDE [m] at HORIZONS_S of plans against the expert's, both (M, PLAN_POINTS, 2)."""
    gap = plans.astype(np.float64) - expert
    error = np.sqrt((gap * gap).sum(axis=-1))
    errors: dict[str, float] = {}
    for horizon in HORIZONS_S:
        points = round(horizon / PLAN_INTERVAL_S)
        errors[f"ade_{horizon:.0f}s_m"] = float(error[:, :points].mean())
        errors[f"fde_{horizon:.0f}s_m"] = float(error[:, points - 1].mean())
    return errors


def measure_by_kind(plans: Float, expert: Float, kinds: npt.NDArray[np.str_]) -> dict[str, dict[str, float]]:
    """Return the number of samples and the ADE over 3 s [m] for each kind of sample."""
    metrics_by_kind: dict[str, dict[str, float]] = {}
    for kind in sorted(set(kinds.tolist())):
        rows = kinds == kind
        metrics_by_kind[kind] = {
            "samples": int(rows.sum()),
            "ade_3s_m": measure_plans(plans[rows], expert[rows])["ade_3s_m"],
        }
    return metrics_by_kind


def measure_controls(controls: Float, expert: Float) -> Mapping[str, float]:
    """Return the mean L1 distances of throttle, brake and steer (M, 3)."""
    gap = np.abs(controls.astype(np.float64) - expert).mean(axis=0)
    return dict(zip(("throttle", "brake", "steer"), gap.tolist(), strict=True))


def describe_plans(plans: Float, arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, Any]:
    """Return metrics of plans for all samples of `arrays`, by kind, and those of constant velocity."""
    expert = arrays["expert_plan"]
    constant = measure_plans(predict_constant_velocity(arrays["own"]), expert)
    learned = measure_plans(plans, expert)
    return {
        "samples": len(plans),
        "plan": learned,
        "constant_velocity": constant,
        "share_of_constant_velocity": learned["ade_3s_m"] / max(constant["ade_3s_m"], 1e-9),
        "by_kind": measure_by_kind(plans, expert, name_kinds(arrays)),
    }
