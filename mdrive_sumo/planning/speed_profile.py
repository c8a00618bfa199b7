"""Speed profiles along a path, and the constraints of a search for one (`profile_search`)."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.planning.parameters import MARGINS, PROFILE, ProfileParameters, SafetyMargin
from mdrive_sumo.planning.reference_path import PathState, ReferencePath
from mdrive_sumo.planning.speed_lattice import (
    FINE,
    SAMPLE_S,
    SpeedLattice,
    find_path_points,
)


@dataclass(frozen=True)
class SpeedProfile:
    """Motion along a path: arc length (K,) [m] and speed (K,) [m/s] every `step_s`, linear speed in between."""

    s: Float
    speed: Float
    reaches_goal: bool
    """A profile that does not reach its goal is the best that could be found."""
    step_s: float = FINE.step_s
    """[s] Between two points."""

    def get_stations(self, t: Float) -> Float:
        """Return the arc length (N,) [m] at times t >= 0 [s]; beyond the end at the last speed."""
        return compute_stations(self, t)

    def append(self, other: "SpeedProfile") -> "SpeedProfile":
        """Return this profile followed by another one that begins where this one ends."""
        s, speed = np.append(self.s, other.s[1:]), np.append(self.speed, other.speed[1:])
        return SpeedProfile(s, speed, other.reaches_goal, self.step_s)

    def extend_standstill(self, layers: int) -> "SpeedProfile":
        """Return this profile followed by that many steps of standing."""
        return replace(self, s=np.append(self.s, [self.s[-1]] * layers), speed=np.append(self.speed, [0.0] * layers))


@twin
def compute_stations(profile: SpeedProfile, t: Float, /) -> Float:
    """As `SpeedProfile.get_stations`."""
    k = np.clip((t / profile.step_s).astype(np.int64), 0, len(profile.s) - 1)
    rest = t - k * profile.step_s
    acceleration = np.append(np.diff(profile.speed), 0.0) / profile.step_s
    return profile.s[k] + profile.speed[k] * rest + acceleration[k] * (rest * rest) / 2


@twin
def compute_station(profile: SpeedProfile, t: float, /) -> float:
    """As `SpeedProfile.get_stations`, at one time."""
    return float(compute_stations(profile, np.full(1, t))[0])


@dataclass(frozen=True)
class SpeedProfileProblem:
    """The constraints of a speed profile. Cell j lies j cells of the lattice ahead of `lattice_s`."""

    start_s: float
    """Arc length [m] of the car."""
    speed: float
    """[m/s] at the start."""
    cells: Int
    """(J,) index of the path's point at each cell."""
    limits: Int
    """(J,) highest speed [speed steps of the lattice] in each cell."""
    goals: slice
    """The cells in which the profile may end."""
    blocked: Bool
    """(T, J): whether a cell is occupied at time (row + 1) · SAMPLE_S; T is a multiple of the lattice's samples."""
    must_move: Bool
    """(T / samples,) layers at which the car must not stand."""
    ends_standing: bool = False
    """Whether the profile must end with speed 0 in one of the `goals`."""
    wait_penalty: float = 0.0
    """Cost of a step per cell that is still ahead, relative to the squared acceleration: without it, a car that cannot
    reach the goal yet drives when it is gentlest, which may be late."""
    lattice: SpeedLattice = FINE
    blocked_after: Bool = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """(J,) whether a cell stays occupied after the last row: a profile that ends on the way must be able to stop before
    it. Empty if nothing is known."""

    @property
    def lattice_s(self) -> float:
        """Arc length [m] of cell 0 after the first step: a car that starts between two speeds is not on the lattice."""
        return self.start_s + self.lattice.compute_shift(self.speed)

    @property
    def times(self) -> Float:
        """(T,) [s] from the start: when cells must be free."""
        return np.arange(1, len(self.blocked) + 1, dtype=np.float64) * SAMPLE_S

    def add_traffic(
        self,
        block: Callable[[SafetyMargin], Bool],
        min_margin: SafetyMargin = MARGINS.contact,
        plan_margin: SafetyMargin = MARGINS.plan,
        parameters: ProfileParameters = PROFILE,
    ) -> "SpeedProfileProblem":
        """Return the problem with the cells that others block: block(margin) returns them, (T, J).

        Where `plan_margin` is violated from the start on (cars may start bumper to bumper, closer than a profile
        would ever bring them), only `min_margin` counts within the stopping distance until the margin is restored.
        """
        blocked = block(plan_margin)
        cell_m = self.lattice.cell_m
        near = int(parameters.forgiving_m / cell_m) + int((self.speed * self.speed) / 8 / cell_m)
        if blocked[:1, :near].any():
            violated = np.logical_and.accumulate(blocked[:, :near], axis=0)
            blocked[:, :near] &= ~violated | block(min_margin)[:, :near]
            blocked[:, 0] &= ~violated[:, 0]
        return replace(self, blocked=blocked)

    def require_stop(self, low: float, high: float) -> "SpeedProfileProblem":
        """Return the problem of stopping between two arc lengths [m]."""
        first, last = (max(math.ceil((s - self.lattice_s) / self.lattice.cell_m), 0) for s in (low, high))
        return replace(self, goals=slice(first, max(last, first + 1)), ends_standing=True)

    def build_remainder(self, part: SpeedProfile) -> "SpeedProfileProblem":
        """Return the problem that remains after a profile that ends standing."""
        lattice = self.lattice
        layers, cells = len(part.s) - 1, round((part.s[-1] - self.lattice_s) / lattice.cell_m)
        return SpeedProfileProblem(
            start_s=float(part.s[-1]),
            speed=0.0,
            cells=self.cells[cells:],
            limits=self.limits[cells:],
            goals=slice(max((self.goals.start or 0) - cells, 0), None),
            blocked=self.blocked[layers * lattice.samples :, cells:],
            must_move=self.must_move[layers:],
            lattice=lattice,
            blocked_after=self.blocked_after[cells:],
        )


def build_free_road_problem(
    path: ReferencePath,
    speeds: Float,
    start: PathState,
    now_s: float,
    until_s: float,
    lattice: SpeedLattice = FINE,
    reach_s: float = math.inf,
) -> SpeedProfileProblem:
    """Return the problem of driving to the goal on a free road.

    speeds: (M,) limit [m/s] at each point of the path; now_s, until_s: the present time and the time limit [s] of the
    episode; reach_s: only cells that a car can reach within this time are of interest.
    """
    first_s, speed = start.s, max(start.speed, 0.0)
    lattice_s = first_s + lattice.compute_shift(speed)
    goal = max(math.ceil((path.goal_s + PROFILE.beyond_goal_m - lattice_s) / lattice.cell_m), 0)
    count = goal + lattice.max_cells_per_step + 1
    if math.isfinite(reach_s):
        count = min(count, round(reach_s * lattice.top_speed / lattice.cell_m))
    cells, limits = list_cells(speeds, lattice, lattice_s, count)
    layers = max(int((until_s - now_s) / lattice.step_s), 1)
    return SpeedProfileProblem(
        start_s=first_s,
        speed=speed,
        cells=cells,
        limits=limits,
        goals=slice(min(goal, count), None),
        blocked=np.zeros((layers * lattice.samples, len(cells)), dtype=np.bool_),
        must_move=_find_moving_layers(now_s, layers, lattice),
        lattice=lattice,
    )


@twin
def list_cells(speeds: Float, lattice: SpeedLattice, lattice_s: float, count: int, /) -> tuple[Int, Int]:
    """Return `SpeedProfileProblem.cells` and `limits` of that many cells; speeds: (M,) at the points of the path."""
    cells = np.minimum(find_path_points(lattice, lattice_s, np.arange(count)), len(speeds) - 1)
    return cells, np.maximum(np.floor(speeds[cells] / lattice.speed_step + 1e-6).astype(np.int64), 1)


def _find_moving_layers(now_s: float, layers: int, lattice: SpeedLattice) -> Bool:
    """Return a mask (layers,): at which layers a car must move so that it is never taken for blocked."""
    ends = now_s + (np.arange(layers) + 1) * lattice.step_s
    period_s = PROFILE.idle_period_s
    return (ends >= period_s) & (ends % period_s < PROFILE.idle_move_s)


def build_braking_profile(problem: SpeedProfileProblem) -> SpeedProfile:
    """Return the profile that stops as soon as possible, whatever is in the way."""
    lattice = problem.lattice
    first = round(problem.speed / lattice.speed_step)
    speeds = np.arange(first, -1, lattice.emergency_move, dtype=np.float64)
    speeds = (np.append(speeds, 0.0) if speeds[-1] else speeds) * lattice.speed_step
    if lattice.has_exact_start:
        speeds[0] = problem.speed
    steps = np.concatenate(((0.0,), (speeds[1:] + speeds[:-1]) / 2 * lattice.step_s))
    return SpeedProfile(problem.start_s + np.cumsum(steps), speeds, reaches_goal=False, step_s=lattice.step_s)
