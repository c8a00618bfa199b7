"""Argoverse 2: select the reader of a folder, a motion-forecasting scenario or a sensor log, by its files."""

from pathlib import Path

from mdrive_sumo.core.errors import InputError
from real2sim.readers.argoverse2_forecasting import read_argoverse2_forecasting
from real2sim.readers.argoverse2_sensor import read_argoverse2_sensor
from real2sim.recording import Recording


def read_argoverse2(folder: Path) -> Recording:
    """Read a folder of either part of Argoverse 2; raise InputError."""
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of Argoverse 2, found {'a file' if folder.exists() else 'none'}")
    if any(folder.glob("*.parquet")):
        return read_argoverse2_forecasting(folder)
    if any(folder.glob("*.feather")):
        return read_argoverse2_sensor(folder)
    raise InputError(f"{folder}: expected scenario_*.parquet or annotations.feather of Argoverse 2, found neither")
