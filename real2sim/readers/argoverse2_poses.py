"""Rigid poses in Argoverse 2 tables: quaternion (w, x, y, z), translation [m], time [ns]."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Int
from real2sim.readers.arrow_tables import Columns

POSE_COLUMNS = ("timestamp_ns", "qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
MAX_TIME_NS = 4e18
"""[ns] since 1970, 126 years: the difference of two such times still is an int64."""


@dataclass(frozen=True)
class PoseSeries:
    """Positions and rotations of a box or of the ego at times (N,) [s]."""

    t: Float
    xyz: Float
    """(N, 3) [m]"""
    quaternion: Float
    """(N, 4) unit quaternions w, x, y, z."""

    def interpolate(self, t: Float) -> "PoseSeries":
        """Interpolate linearly and normalise the quaternions, which is accurate enough over 10 ms."""
        signs = np.cumprod(np.where((self.quaternion[1:] * self.quaternion[:-1]).sum(1) < 0, -1.0, 1.0))
        smooth = self.quaternion * np.concatenate(((1.0,), signs))[:, None]
        xyz, mixed = (
            np.column_stack([np.interp(t, self.t, column) for column in rows.T]) for rows in (self.xyz, smooth)
        )
        return PoseSeries(t, xyz, mixed / np.linalg.norm(mixed, axis=1)[:, None])

    @property
    def rotation(self) -> Float:
        """Rotation matrices (N, 3, 3)."""
        w, x, y, z = self.quaternion.T
        rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def parse_poses(path: Path, rows: Columns, start_ns: int) -> PoseSeries:
    """Return the poses of all rows of a table with times since `start_ns`; raise InputError."""
    quaternion = np.column_stack([rows[name] for name in POSE_COLUMNS[1:5]])
    length = np.linalg.norm(quaternion, axis=1)
    bad = np.abs(length - 1) > 0.01
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise InputError(
            f"{path}: qw, qx, qy, qz: expected quaternions of length 1, found {length[row]:g} in row {row}"
        )
    xyz = np.column_stack([rows[name] for name in POSE_COLUMNS[5:]]).astype(np.float64)
    return PoseSeries(to_seconds(check_times(path, rows), start_ns), xyz, quaternion / length[:, None])


def to_seconds(timestamp_ns: Int, start_ns: int) -> Float:
    """Return times [s] since a start; both are within `MAX_TIME_NS`."""
    return (timestamp_ns - start_ns).astype(np.float64) / 1e9


def check_times(path: Path, rows: Columns) -> Int:
    """Return the column `timestamp_ns` as integers whose differences do not overflow; raise InputError."""
    times = rows["timestamp_ns"]
    if (np.abs(times.astype(np.float64)) > MAX_TIME_NS).any():
        raise InputError(f"{path}: timestamp_ns: expected times within 126 years of 1970, found others")
    return times.astype(np.int64)
