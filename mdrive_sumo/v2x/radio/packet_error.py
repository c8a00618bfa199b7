"""Packet error rate over SINR: published link-level curves, and their dependence on size.

The curves are those of Wu, Bartoletti, Martinez, Todisco and Bazzi (Sensors 22(23), 9330, 2022), published with the
simulator WiLabV2Xsim: packets of 350 bytes over the vehicular channel models that ETSI and the IEEE use for 802.11p
(urban approaching LOS, crossing NLOS, highway LOS, highway NLOS). They contain fading in time and frequency, which is
therefore nowhere else in this model.
"""

import math
from collections.abc import Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import Final

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.v2x.radio.path_loss import Classes, RadioEnvironment
from mdrive_sumo.v2x.radio.radio_settings import RadioProfile

CURVE_BYTES: Final = 350
"""Size of the packets of the curves."""
FIRST_DB, STEP_DB, LAST_DB = -2.0, 0.5, 12.0
"""[dB] SINR of the first and last value of a curve, and between its values. Below all packets are lost, above none."""
_POINTS = 1 + round((LAST_DB - FIRST_DB) / STEP_DB)
"""Number of values of a curve."""


def _refine(first_db: int, *values: float) -> tuple[float, ...]:
    """Return a curve with a value every 0.5 dB of one with a value every dB, whose first value is at `first_db`."""
    known = [1.0] * (first_db - round(FIRST_DB)) + [*values]
    known += [0.0] * ((_POINTS + 1) // 2 - len(known))
    halves = [(a + b) / 2 for a, b in pairwise(known)]
    return tuple([value for pair in zip(known, [*halves, 0.0], strict=True) for value in pair][:_POINTS])


def _pad(*values: float) -> tuple[float, ...]:
    return values + (0.0,) * (_POINTS - len(values))


_G5_URBAN_LOS = _refine(-2, 0.9996, 0.992, 0.919, 0.7262, 0.4598, 0.22, 0.0798, 0.0286, 0.0052, 0.0022, 0.0002)
_G5_CROSSING_NLOS = _refine(1, 0.9896, 0.933, 0.766, 0.5012, 0.2412, 0.087, 0.0236, 0.0068, 0.0008, 0.0002)
_G5_HIGHWAY_LOS = _refine(-2, 0.9916, 0.9388, 0.7662, 0.5076, 0.264, 0.1108, 0.0404, 0.0132, 0.0028, 0.001, 0.0002)
_G5_HIGHWAY_NLOS = _refine(1, 0.996, 0.9714, 0.8928, 0.6886, 0.4328, 0.2014, 0.0712, 0.02, 0.0024, 0.001)
"""IEEE 802.11p, QPSK 1/2 (6 Mbit/s in 10 MHz)."""
_LTE_URBAN_LOS = _pad(
    0.9998, 0.999, 0.9984, 0.9922, 0.9816, 0.9514, 0.8942, 0.8144, 0.7102, 0.583, 0.4532, 0.328, 0.2238, 0.1416,
    0.0888, 0.0534, 0.0292, 0.0148, 0.0088, 0.0048, 0.0024, 0.0012, 0.0002, 0.0002,
)  # fmt: skip
_LTE_CROSSING_NLOS = _pad(
    1.0, 1.0, 1.0, 1.0, 0.9998, 0.9998, 0.9992, 0.9972, 0.9906, 0.9744, 0.9406, 0.883, 0.7902, 0.6724,
    0.5342, 0.3896, 0.2558, 0.1556, 0.0828, 0.0428, 0.0204, 0.0088, 0.0038, 0.0022, 0.0008, 0.0004,
)  # fmt: skip
_LTE_HIGHWAY_LOS = _pad(
    0.9996, 0.998, 0.9914, 0.9792, 0.9424, 0.8758, 0.7812, 0.6504, 0.5016, 0.376, 0.2568, 0.1776, 0.114, 0.0634,
    0.0386, 0.0228, 0.012, 0.0056, 0.0038, 0.0022, 0.001, 0.0008, 0.0006, 0.0004, 0.0002,
)  # fmt: skip
_LTE_HIGHWAY_NLOS = _pad(
    1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.9998, 0.9986, 0.9964, 0.9872, 0.9662, 0.9214, 0.849,
    0.7244, 0.5694, 0.3992, 0.2544, 0.1422, 0.0686, 0.03, 0.0146, 0.0066, 0.0026, 0.001, 0.0002, 0.0002,
)  # fmt: skip
"""LTE-V2X sidelink, MCS 7 (QPSK)."""


class PacketErrorModel:
    """Packet error rates of one profile in one environment, by `LinkClass`.

    A link behind a vehicle has the curve "highway NLOS" in both environments, one behind a building "crossing NLOS".
    """

    def __init__(self, profile: RadioProfile, environment: RadioEnvironment) -> None:
        curves = _CURVES[profile]
        los = curves[0] if environment is RadioEnvironment.URBAN else curves[1]
        self.curves = np.array((los, curves[2], curves[3]))
        """(3, points) by `LinkClass`, from `FIRST_DB`."""
        self.blurred = np.array([_blur(curve) for curve in self.curves.tolist()])
        """The same if the SINR varies with `BLUR_DB`, from `BLUR_FIRST_DB`."""

    def compute(self, sinr_db: Float, classes: Classes, size: int) -> Float:
        """Return the error rate (...,) of packets of `size` bytes, headers included.

        Of another size than the curve's: 1 - (1 - PER)^(size / 350), as if bytes failed independently.
        """
        rate = interpolate(self.curves, FIRST_DB, sinr_db, classes)
        if size == CURVE_BYTES:
            return rate
        intact = np.maximum(1.0 - rate, 1e-300)
        return np.where(rate < 1.0, 1.0 - portable.exp(size / CURVE_BYTES * portable.log(intact)), 1.0)


BLUR_DB: Final = 3.0
"""Standard deviation [dB] of an interferer's shadowing: that of LOS, which most interferers that count have."""
BLUR_FIRST_DB: Final = FIRST_DB - 4.0 * BLUR_DB
"""[dB] First value of a blurred curve: `_blur` spreads each point over four standard deviations."""


def interpolate(curves: Float, first_db: float, sinr_db: Float, classes: Classes) -> Float:
    """Return the values of curves (3, points) from `first_db` by class at these SINRs [dB], linear between points."""
    points = curves.shape[1]
    place = (sinr_db - first_db) / STEP_DB
    inside = np.minimum(np.maximum(place, 0.0), points - 1.0)
    row = np.minimum(inside.astype(np.intp), points - 2)
    share = inside - row
    flat, start = curves.ravel(), classes.astype(np.intp) * points + row
    values = flat[start] * (1.0 - share) + flat[start + 1] * share
    return np.where(place < 0.0, 1.0, values)


def _blur(curve: list[float]) -> tuple[float, ...]:
    """Return the mean of the curve under normal errors of `BLUR_DB` around each point, in the same steps."""
    beyond = round(4.0 * BLUR_DB / STEP_DB)
    offsets = range(-beyond, beyond + 1)
    weights = [portable.exp(-0.5 * (k * STEP_DB / BLUR_DB) * (k * STEP_DB / BLUR_DB)) for k in offsets]
    whole = math.fsum(weights)
    extended = [1.0] * (2 * beyond) + curve + [0.0] * (2 * beyond)
    middles = range(beyond, len(extended) - beyond)
    return tuple(math.fsum(w * extended[i + k] for w, k in zip(weights, offsets, strict=True)) / whole for i in middles)


_CURVES: Mapping[RadioProfile, tuple[tuple[float, ...], ...]] = MappingProxyType(
    {
        RadioProfile.ITS_G5: (_G5_URBAN_LOS, _G5_HIGHWAY_LOS, _G5_HIGHWAY_NLOS, _G5_CROSSING_NLOS),
        RadioProfile.LTE_V2X: (_LTE_URBAN_LOS, _LTE_HIGHWAY_LOS, _LTE_HIGHWAY_NLOS, _LTE_CROSSING_NLOS),
    }
)
"""Curves of urban LOS, highway LOS, NLOSv and NLOSb."""
