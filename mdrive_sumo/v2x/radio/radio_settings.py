"""RadioSettings: the options of a channel that is a radio."""

from dataclasses import dataclass
from enum import StrEnum

from mdrive_sumo.core.errors import InputError


class RadioProfile(StrEnum):
    """Radio technology of all stations of an episode."""

    ITS_G5 = "its-g5"
    LTE_V2X = "lte-v2x"


class CornerModel(StrEnum):
    """Path loss between stations that a building separates."""

    TR_37885 = "tr-37.885"
    """Urban NLOS of 3GPP TR 37.885: a function of the distance alone."""
    VIRTUAL_SOURCE = "virtual-source"
    """VirtualSource11p (EURASIP JWCN 2011:182) where both stations see a junction between them."""


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """A radio. Raises InputError for invalid values.

    Defaults of power and gain are the evaluation assumptions of 3GPP TR 37.885, section 6.1, for vehicles at 6 GHz.
    """

    profile: RadioProfile
    power_dbm: float = 23.0
    """Transmit power at the antenna's connector, the same for all stations."""
    antenna_gain_dbi: float = 3.0
    """Gain of each antenna, towards all sides."""
    connected_background: float = 0.0
    """Share in [0, 1] of the background vehicles that send CAMs."""
    corner_model: CornerModel = CornerModel.TR_37885

    def __post_init__(self) -> None:
        for name, kind in (("profile", RadioProfile), ("corner_model", CornerModel)):
            if not isinstance(getattr(self, name), kind):
                _refuse(self, name, f"one of {', '.join(kind)}")
        if not 0.0 <= self.power_dbm <= 33.0:
            _refuse(self, "power_dbm", "a transmit power from 0 to 33 dBm (ETSI EN 302 571: at most 33 dBm EIRP)")
        if not -20.0 <= self.antenna_gain_dbi <= 20.0:
            _refuse(self, "antenna_gain_dbi", "a gain from -20 to 20 dBi")
        if not 0.0 <= self.connected_background <= 1.0:
            _refuse(self, "connected_background", "a share in [0, 1]")


def _refuse(settings: RadioSettings, name: str, expected: str) -> None:
    raise InputError(f"V2X channel: {name}: expected {expected}, found {getattr(settings, name)!r:.40}")
