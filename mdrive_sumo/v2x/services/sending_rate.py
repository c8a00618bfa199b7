"""When the stations of built-in agents send: the setting `--v2x-rate`."""

from enum import StrEnum


class SendingRate(StrEnum):
    """When CAMs, CPMs and MCMs are sent, the same for every station of an episode that is not an agent's own affair."""

    FIXED = "fixed"
    """CAMs and CPMs every 100 ms, MCMs in every planning step (200 ms), no DENMs: how all runs were before `ETSI`."""
    ETSI = "etsi"
    """By the generation rules of ETSI EN 302 637-2 (CAM), TS 103 324 (CPM) and EN 302 637-3 (DENM)."""
