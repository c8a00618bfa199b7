"""Commands for OpenGL to draw many parts of a buffer by one call."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.geometry import Bool, Int
from mdrive_sumo.sensing.camera.instances import MODEL_FIRST, MODEL_SURFACE
from mdrive_sumo.sensing.camera.meshes import Surface
from mdrive_sumo.sensing.camera.static_scene import Chunks

COLUMNS = 5
"""Vertices, instances, first vertex, first instance, padding: moderngl strides as for indexed drawing."""


@dataclass(frozen=True, slots=True)
class CommandRuns:
    """Commands (C, COLUMNS), and for each surface its first command and their number."""

    commands: npt.NDArray[np.uint32]
    surfaces: tuple[tuple[Surface, int, int], ...]


def list_chunk_commands(chunks: Chunks, visible: Bool) -> CommandRuns:
    """Return commands for the visible chunks (K,); neighbours of one surface are drawn together."""
    rows = np.flatnonzero(visible)
    first, count, surface = chunks.first[rows], chunks.count[rows], chunks.surface[rows]
    starts = np.ones(len(rows), dtype=np.bool_)
    starts[1:] = (first[1:] != first[:-1] + count[:-1]) | (surface[1:] != surface[:-1])
    begin = np.flatnonzero(starts)
    commands = np.zeros((len(begin), COLUMNS), dtype=np.uint32)
    if len(begin):
        commands[:, 0] = np.add.reduceat(count, begin)
    commands[:, 1], commands[:, 2] = 1, first[begin]
    return CommandRuns(commands, _find_surfaces(surface[begin]))


def list_instance_commands(models: Int) -> CommandRuns:
    """Return a command for each model (index into `MESHES`) among the instances (N,), which are in this order."""
    number = np.bincount(models, minlength=len(MODEL_SURFACE))
    present = np.flatnonzero(number)
    commands = np.zeros((len(present), COLUMNS), dtype=np.uint32)
    commands[:, 0], commands[:, 1], commands[:, 2] = (
        MODEL_FIRST[present + 1] - MODEL_FIRST[present],
        number[present],
        MODEL_FIRST[present],
    )
    commands[:, 3] = np.cumsum(number[present]) - number[present]
    order = np.argsort(MODEL_SURFACE[present], kind="stable")
    return CommandRuns(commands[order], _find_surfaces(MODEL_SURFACE[present[order]]))


def _find_surfaces(surface: Int) -> tuple[tuple[Surface, int, int], ...]:
    """Return the runs of equal surfaces of commands (C,), which are ordered by them."""
    runs = ((kind, *np.searchsorted(surface, (kind, kind + 1)).tolist()) for kind in Surface)
    return tuple((kind, first, end - first) for kind, first, end in runs if end > first)
