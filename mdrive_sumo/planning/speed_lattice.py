"""The lattice of speed profiles: its resolution is a property of the speeds that are planned with it.

A step of duration T with the move k changes speed n·V to (n + k)·V and moves the car (2n + k)·V·T/2 ahead: with cells
of V·T/2 every move ends exactly on the lattice, and nothing is rounded.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.planning.reference_path import SPACING_M

SAMPLE_S = 0.125
"""A cell must be free at every sample of a step, so far apart: at 33 m/s a car moves less than its own length."""


@dataclass(frozen=True, slots=True)
class SpeedLattice:
    """Resolution, range and moves of a search for speed profiles."""

    step_s: float
    """Duration T of a step between two layers; a multiple of `SAMPLE_S`."""
    speed_step: float
    """Difference V between two speeds [m/s]."""
    top: int
    """Number of speed steps of the highest speed."""
    moves: tuple[int, ...] = (1, 0, -1, -2)
    """Changes of speed [speed steps] in a step."""
    efforts: tuple[float, ...] = (1.0, 0.0, 1.0, 4.0)
    """Cost of each move: the square of the acceleration."""
    has_exact_start: bool = False
    """Whether a profile begins at the car's own speed, which lies between two of the lattice; else it is rounded."""
    emergency_move: int = -2
    """Change of speed [speed steps] in a step of a car for which every profile collides."""

    @property
    def cell_m(self) -> float:
        """Length of a cell [m]."""
        return self.speed_step * self.step_s / 2

    @property
    def samples(self) -> int:
        """Samples in a step."""
        return round(self.step_s / SAMPLE_S)

    @property
    def top_speed(self) -> float:
        """The highest speed [m/s]."""
        return self.top * self.speed_step

    @property
    def max_cells_per_step(self) -> int:
        """Cells that a car at the highest speed passes in a step."""
        return 2 * self.top

    def find_index(self, speed: float) -> int:
        """Return the number of speed steps nearest to a speed [m/s]."""
        return min(round(speed / self.speed_step), self.top)

    def compute_shift(self, speed: float) -> float:
        """Return how much further than on the lattice [m] a car with that speed [m/s] is after its first step."""
        if not self.has_exact_start:
            return 0.0
        return (speed - self.find_index(speed) * self.speed_step) * self.step_s / 2


@dataclass(frozen=True, slots=True)
class LatticeParameters:
    """Choice of the lattice. Design choices: the cost of a search is about equal for all speeds (decision 053)."""

    fine_top_speed: float = 10.0
    """[m/s] Up to this speed `FINE` is used."""
    medium_top_speed: float = 17.0
    """[m/s] Up to this speed (60 km/h) steps take `medium` (duration [s], speed [m/s]), above it `coarse`."""
    medium: tuple[float, float] = (0.5, 1.0)
    """Duration of a step [s] and difference between two speeds [m/s]."""
    coarse: tuple[float, float] = (1.0, 2.0)
    """Likewise. A car at 33 m/s has 17 speeds, as one at 8 m/s has 9 on the fine lattice."""


FINE = SpeedLattice(step_s=0.5, speed_step=1.0, top=10)
"""The lattice of the speeds of the protocol: accelerations 2, 0, -2 and -4 m/s2, cells of 0.25 m."""
LATTICE = LatticeParameters()


def choose_lattice(top_speed: float, parameters: LatticeParameters = LATTICE) -> SpeedLattice:
    """Return the lattice for cars that drive up to `top_speed` [m/s].

    Above the speeds of the protocol it contains `top_speed` itself, brakes with up to 6 m/s2 (which costs more than its
    square: only where nothing else helps), and begins at the car's own speed.
    """
    if top_speed <= parameters.fine_top_speed:
        return FINE
    step_s, speed_step = parameters.medium if top_speed <= parameters.medium_top_speed else parameters.coarse
    top = math.ceil(top_speed / speed_step - 1e-9)
    return SpeedLattice(
        step_s=step_s,
        speed_step=top_speed / top,
        top=top,
        moves=(1, 0, -1, -2, -3),
        efforts=(1.0, 0.0, 1.0, 4.0, 25.0),
        has_exact_start=True,
        emergency_move=-3,
    )


@dataclass(frozen=True)
class Transitions:
    """The predecessors of the states (speed, cell) of a lattice, by move (first axis) and speed."""

    before: Int
    """(moves, speeds) number of speed steps of the previous state; 0 where the move is not legal."""
    advance: Int
    """(moves, speeds) cells that the move passes; 0 where it is not legal."""
    back: Int
    """(1 or moves, samples, speeds) cells from each sample of the step to its end; 1: equal for all moves."""
    is_illegal: Bool
    """(moves, speeds)"""
    effort: Float
    """(moves, 1, 1)"""
    reach: int
    """The largest number of `advance` and `back`."""


@lru_cache(maxsize=16)
def build_transitions(lattice: SpeedLattice) -> Transitions:
    """Return the transitions of a lattice."""
    moves, speeds = np.array(lattice.moves), np.arange(lattice.top + 1)
    before = speeds[None] - moves[:, None]
    is_legal = (before >= 0) & (before <= lattice.top)
    advance = np.where(is_legal, speeds[None] + before, 0)
    remaining = 1 - np.arange(1, lattice.samples + 1) / lattice.samples  # share of the step after each sample
    cells = 2 * remaining[None, :, None] * speeds[None, None]
    if lattice.has_exact_start:  # in a long step the acceleration counts
        cells = np.maximum(cells - moves[:, None, None] * np.square(remaining)[None, :, None], 0.0)
    back = np.round(cells).astype(np.int64)
    effort = np.array(lattice.efforts)[:, None, None]
    reach = int(max(advance.max(), back.max()))
    return Transitions(np.where(is_legal, before, 0), advance, back, ~is_legal, effort, reach)


def find_path_points(lattice: SpeedLattice, s: float, ahead: Int) -> Int:
    """Return the indices (J,) of the points of a path (`SPACING_M` apart) nearest to cells `ahead` (J,) of s [m]."""
    return round(s / SPACING_M) + np.round(ahead * (lattice.cell_m / SPACING_M)).astype(np.int64)
