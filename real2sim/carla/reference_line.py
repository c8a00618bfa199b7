"""Poses on the reference line of an OpenDRIVE road (ASAM OpenDRIVE 1.7, chapter 9)."""

import math
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, wrap_angle
from real2sim.xml_file import Element, read_number

SHAPES = ("line", "arc", "spiral", "poly3", "paramPoly3")
CUBIC_STEP_M = 0.1
"""[m] Four chords of a cubic take its place; at a radius of 1 m a chord is 0.1 mm off."""
MAX_STEPS = 10_000
"""Steps along one piece: of pieces above 1 km they are longer, as are their radii."""

LARGEST = 1e8
"""Of coordinates [m], angles [rad], curvatures [1/m] and coefficients of cubics: beyond it, sums and sines of doubles
mean nothing."""

Pose = tuple[float, float, float]
"""x, y [m], direction [rad]."""


def check_geometry(path: Path, road: Element) -> None:
    """Raise InputError for a piece without one of the shapes that the standard defines."""
    for piece in road.iterfind("planView/geometry"):
        shapes = [part.tag for part in piece if part.tag != "userData"]
        if len(shapes) != 1 or shapes[0] not in SHAPES:
            raise InputError(
                f"{path}: road {road.get('id')}: expected a line, arc, spiral, poly3 or paramPoly3 in every geometry, "
                f"found {', '.join(shapes) or 'none'}"
            )


def compute_pose(path: Path, road: Element, s: float) -> Pose:
    """Return the pose on the reference line at s [m], at its nearer end for s beyond; raise InputError."""
    pieces = sorted(road.iterfind("planView/geometry"), key=lambda piece: read_number(path, piece, "s"))
    if not pieces:
        raise InputError(f"{path}: road {road.get('id')}: expected a geometry, found none")
    begun = [piece for piece in pieces if read_number(path, piece, "s") <= s]
    piece = begun[-1] if begun else pieces[0]
    x, y, yaw, start, length = (read_number(path, piece, name) for name in ("x", "y", "hdg", "s", "length"))
    if max(map(abs, (x, y, yaw, start, length, s))) > LARGEST:
        raise InputError(f"{path}: road {road.get('id')}: expected numbers within {LARGEST:g}, found a larger one")
    u, v, turned = _follow(path, piece, min(max(s - start, 0.0), length), length)
    if not all(map(math.isfinite, (u, v, turned))):
        raise InputError(f"{path}: road {road.get('id')}: expected a geometry with finite places, found others")
    return (
        x + u * math.cos(yaw) - v * math.sin(yaw),
        y + u * math.sin(yaw) + v * math.cos(yaw),
        wrap_angle(yaw + turned),
    )


def _follow(path: Path, piece: Element, ds: float, length: float) -> Pose:
    """Return the pose after ds [m] on a piece, relative to its start."""
    shape = next(part for part in piece if part.tag in SHAPES)
    if shape.tag == "line" or ds == 0.0:
        return ds, 0.0, 0.0
    if shape.tag == "arc":
        turned = ds * _read_bounded(path, shape, "curvature")
        chord = ds * float(np.sinc(turned / 2 / math.pi))
        return chord * math.cos(turned / 2), chord * math.sin(turned / 2), turned
    if shape.tag == "spiral":
        first, last = (_read_bounded(path, shape, name) for name in ("curvStart", "curvEnd"))
        return _follow_spiral(first, (last - first) / length, ds)
    return _follow_cubic(*_read_cubic(path, shape, length), ds)


def _read_bounded(path: Path, shape: Element, name: str) -> float:
    """Return a curvature [1/m] or a coefficient; raise InputError for one whose angles or places mean nothing."""
    if abs(value := read_number(path, shape, name)) > LARGEST:
        raise InputError(f"{path}: {shape.tag}: {name}: expected a number within {LARGEST:g}, found {value:g}")
    return value


def _follow_spiral(curvature: float, change: float, ds: float) -> Pose:
    """Integrate a clothoid by Gauss's rule of five points on pieces of a metre."""
    count = min(max(math.ceil(ds), 1), MAX_STEPS)
    nodes, weights = np.polynomial.legendre.leggauss(5)
    half = ds / count / 2
    nodes_s = (2 * np.arange(count)[:, None] + 1 + nodes) * half
    yaw = curvature * nodes_s + change * np.square(nodes_s) / 2
    return (
        float((np.cos(yaw) * weights).sum()) * half,
        float((np.sin(yaw) * weights).sum()) * half,
        curvature * ds + change * ds * ds / 2,
    )


def _read_cubic(path: Path, shape: Element, length: float) -> tuple[Float, Float, float]:
    """Return coefficients of u(p) and v(p), lowest first, and the parameter at the end of the piece."""
    if shape.tag == "poly3":
        return np.array((0.0, 1.0, 0.0, 0.0)), np.array([_read_bounded(path, shape, name) for name in "abcd"]), length
    u, v = ([_read_bounded(path, shape, f"{name}{axis}") for name in "abcd"] for axis in "UV")
    return np.array(u), np.array(v), length if shape.get("pRange") == "arcLength" else 1.0


def _follow_cubic(u: Float, v: Float, last: float, ds: float) -> Pose:
    """Return the pose where the curve, sampled to its end, is ds [m] long."""
    p = np.linspace(0.0, last, min(max(round(ds / CUBIC_STEP_M), 10), MAX_STEPS) * 4 + 1)
    x, y = (sum((c * p**k for k, c in enumerate(axis)), np.zeros(len(p))) for axis in (u, v))
    s = np.concatenate(((0.0,), np.hypot(np.diff(x), np.diff(y)).cumsum()))
    parameter = float(np.interp(ds, s, p))
    du, dv = (axis[1] + 2 * axis[2] * parameter + 3 * axis[3] * parameter * parameter for axis in (u, v))
    return float(np.interp(ds, s, x)), float(np.interp(ds, s, y)), math.atan2(float(dv), float(du))
