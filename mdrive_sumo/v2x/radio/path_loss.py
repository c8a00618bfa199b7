"""Median path loss of a pair of antennas by what lies between them (3GPP TR 37.885), and the loss round a corner."""

from enum import IntEnum, StrEnum

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float

PER_LN10 = 0.43429448190325182765
"""1 / ln 10."""
CARRIER_GHZ = 5.9
"""Channel 180 of ITS-G5 (5895 to 5905 MHz, ETSI EN 302 663) and band 47 of LTE-V2X (3GPP TS 36.101)."""
WAVELENGTH_M = 299_792_458.0 / (CARRIER_GHZ * 1e9)
"""[m] Speed of light divided by the carrier frequency."""
LEAST_DISTANCE_M = 1.0
"""Nearer antennas count as this far apart: the formulas are fitted to metres and diverge at 0. Our choice."""
SUBURBAN_DB, SOURCE_DB, SOURCE_EXPONENT = 2.94, 3.75, 2.69
"""VirtualSource11p (EURASIP JWCN 2011:182): added loss of suburban crossings, constant, and exponent of the loss."""
SOURCE_TX_EXPONENT, SOURCE_WIDTH_EXPONENT = 0.957, 0.81
"""The same: exponents of the transmitter's distance to the crossing and of street width times distance to the wall."""
SOURCE_SIGMA_DB = 4.1
"""The same: standard deviation [dB] of the fading in the cross street."""


class LinkClass(IntEnum):
    """What lies between two antennas. Recordings store the value."""

    LOS = 0
    """Nothing that is as high as one of them."""
    NLOSV = 1
    """A vehicle."""
    NLOSB = 2
    """A building."""


LINK_NAMES = {LinkClass.LOS: "LOS", LinkClass.NLOSV: "NLOSv", LinkClass.NLOSB: "NLOSb"}
"""Names of the classes of links as TR 37.885 and GEMV2 write them."""


class RadioEnvironment(StrEnum):
    """Which formulas of TR 37.885 hold on a map."""

    URBAN = "urban"
    HIGHWAY = "highway"


Classes = npt.NDArray[np.uint8]
"""Values of `LinkClass`."""

SHADOWING_DB = np.array((3.0, 3.0, 4.0))
"""Standard deviation [dB] of shadowing by `LinkClass`: TR 37.885, table 6.2.1-1."""
DECORRELATION_M = {RadioEnvironment.URBAN: 10.0, RadioEnvironment.HIGHWAY: 25.0}
"""Decorrelation distance [m] of shadowing: TR 37.885, section 6.2.1, and TR 36.885, table A.1.4-1."""

LossFormulas = tuple[float, float, float, float]
"""Loss [dB] at 1 m and its growth [dB] per factor 10 of the distance, without and with a building in between."""
_LOG_GHZ = portable.log(CARRIER_GHZ) * PER_LN10
"""log10 of the carrier frequency in GHz, as the TR's formulas have it."""
_BUILDING = 36.85 + 18.9 * _LOG_GHZ, 30.0
LOSS_FORMULAS: dict[RadioEnvironment, LossFormulas] = {
    RadioEnvironment.URBAN: (38.77 + 18.2 * _LOG_GHZ, 16.7, *_BUILDING),
    RadioEnvironment.HIGHWAY: (32.4 + 20.0 * _LOG_GHZ, 20.0, *_BUILDING),
}
"""TR 37.885, table 6.2.1-1. Buildings have the urban formula in both: the highway of the TR has none."""


def log10(x: Float) -> Float:
    """Return the decimal logarithm of each element."""
    return portable.log(x) * PER_LN10


def from_db(level_db: Float) -> Float:
    """Return the ratio that each level [dB] stands for."""
    return portable.exp(level_db * (0.1 / PER_LN10))


def compute_path_loss(formulas: LossFormulas, classes: Classes, distance: Float) -> Float:
    """Return the median loss [dB] between isotropic antennas, without that of vehicles between them.

    classes, distance: of the same shape; 3-D distance [m] of the antennas.
    """
    slopes = log10(np.maximum(distance, LEAST_DISTANCE_M))
    base, slope, building_base, building_slope = formulas
    return np.where(classes == LinkClass.NLOSB, building_base + building_slope * slopes, base + slope * slopes)


def compute_blockage_mean(distance: Float, low: Float, high: Float, blocker: Float) -> Float:
    """Return the mean [dB] of the loss that a vehicle in between adds: TR 37.885, section 6.2.1, type 1 to 3.

    distance: of the antennas [m]; low, high: heights [m] of the lower and of the higher antenna; blocker: height [m]
    of the highest vehicle in between. 0 where both antennas look over it.
    """
    far = np.maximum(15.0 * log10(np.maximum(distance, LEAST_DISTANCE_M)) - 41.0, 0.0)
    return np.where(low > blocker, 0.0, np.where(high < blocker, 9.0 + far, 5.0 + far))


def find_blockage_sigma(low: Float, high: Float, blocker: Float) -> Float:
    """Return the standard deviation [dB] of that loss."""
    return np.where(low > blocker, 0.0, np.where(high < blocker, 4.5, 4.0))


def compute_corner_loss(
    tx_corner_m: float, rx_corner_m: float, rx_street_m: float, tx_wall_m: float, *, height_m: float, suburban: bool
) -> float:
    """Return the median loss [dB] round the corner of a crossing: VirtualSource11p, both branches.

    tx_corner_m, rx_corner_m: distance of transmitter and receiver to the middle of the crossing; rx_street_m: width of
    the receiver's street between the houses; tx_wall_m: from the transmitter to the houses of its street; height_m: of
    both antennas, which gives the break distance 4 h² / wavelength.
    """
    break_m = 4.0 * height_m * height_m / WAVELENGTH_M
    far_m = rx_corner_m * rx_corner_m / break_m if rx_corner_m > break_m else rx_corner_m
    spread = portable.log(4.0 * 3.141592653589793 * far_m / WAVELENGTH_M)
    walls = SOURCE_TX_EXPONENT * portable.log(tx_corner_m) - SOURCE_WIDTH_EXPONENT * portable.log(
        tx_wall_m * rx_street_m
    )
    return SOURCE_DB + suburban * SUBURBAN_DB + 10.0 * SOURCE_EXPONENT * PER_LN10 * (walls + spread)
