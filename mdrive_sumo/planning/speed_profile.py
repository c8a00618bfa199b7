"""The fastest conflict-free speed profile along a path, by dynamic programming in space and time.

The search runs on a `SpeedLattice`; which one depends on the speeds.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.planning.parameters import MARGINS, PROFILE, ProfileParameters, SafetyMargin
from mdrive_sumo.planning.reference_path import ReferencePath
from mdrive_sumo.planning.speed_lattice import (
    FINE,
    SAMPLE_S,
    SpeedLattice,
    Transitions,
    build_transitions,
    find_path_points,
)

PLANNED_BRAKING_MOVE = -2
"""Change of speed [speed steps] in a step with which a car can always be expected to stop: 4 m/s2."""
SETTLING_LAYERS = 2
"""Layers after the last change before a search may be over."""


@dataclass(frozen=True)
class SpeedProfile:
    """Motion along a path: arc length (K,) [m] and speed (K,) [m/s] every `step_s`, linear speed in between."""

    s: Float
    speed: Float
    reaches_goal: bool
    """A profile that does not reach its goal is the best that could be found."""
    step_s: float = FINE.step_s

    def get_stations(self, t: Float) -> Float:
        """Return the arc length (N,) [m] at times t >= 0 [s]; beyond the end at the last speed."""
        k = np.minimum((t / self.step_s).astype(np.int64), len(self.s) - 1)
        rest = t - k * self.step_s
        acceleration = np.append(np.diff(self.speed), 0.0)[k] / self.step_s
        return self.s[k] + self.speed[k] * rest + acceleration * (rest * rest) / 2

    def append(self, other: "SpeedProfile") -> "SpeedProfile":
        """Return this profile followed by another one that begins where this one ends."""
        s, speed = np.append(self.s, other.s[1:]), np.append(self.speed, other.speed[1:])
        return SpeedProfile(s, speed, other.reaches_goal, self.step_s)

    def extend_standstill(self, layers: int) -> "SpeedProfile":
        """Return this profile followed by that many steps of standing."""
        return replace(self, s=np.append(self.s, [self.s[-1]] * layers), speed=np.append(self.speed, [0.0] * layers))


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
        violated = np.logical_and.accumulate(blocked[:, :near], axis=0)
        if violated.any():
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
    start: tuple[float, float],
    now_s: float,
    until_s: float,
    lattice: SpeedLattice = FINE,
) -> SpeedProfileProblem:
    """Return the problem of driving to the goal on a free road.

    speeds: (M,) limit [m/s] at each point of the path; start: arc length [m] and speed [m/s]; now_s, until_s: the
    present time and the time limit [s] of the episode.
    """
    first_s, speed = start[0], max(start[1], 0.0)
    lattice_s = first_s + lattice.compute_shift(speed)
    goal = max(math.ceil((path.goal_s + PROFILE.beyond_goal_m - lattice_s) / lattice.cell_m), 0)
    ahead = np.arange(goal + lattice.max_cells_per_step + 1)
    cells = np.minimum(find_path_points(lattice, lattice_s, ahead), len(path.xy) - 1)
    layers = max(int((until_s - now_s) / lattice.step_s), 1)
    return SpeedProfileProblem(
        start_s=first_s,
        speed=speed,
        cells=cells,
        limits=np.maximum(np.floor(speeds[cells] / lattice.speed_step + 1e-6).astype(np.int64), 1),
        goals=slice(goal, None),
        blocked=np.zeros((layers * lattice.samples, len(cells)), dtype=np.bool_),
        must_move=_find_moving_layers(now_s, layers, lattice),
        lattice=lattice,
    )


def _find_moving_layers(now_s: float, layers: int, lattice: SpeedLattice) -> Bool:
    """Return a mask (layers,): at which layers a car must move so that it is never taken for blocked."""
    ends = now_s + (np.arange(layers) + 1) * lattice.step_s
    period_s = PROFILE.idle_period_s
    return (ends >= period_s) & (ends % period_s < PROFILE.idle_move_s)


def find_fastest_profile(problem: SpeedProfileProblem) -> SpeedProfile | None:
    """Return the profile that reaches the goal first, with the least squared acceleration among equals.

    If none reaches the goal in time: the one that gets furthest. None if all collide.
    """
    cells, lattice = len(problem.cells), problem.lattice
    transitions, samples = build_transitions(lattice), lattice.samples
    goals = np.zeros((lattice.top + 1, cells), dtype=np.bool_)
    goals[: 1 if problem.ends_standing else None, problem.goals] = True
    cost = np.full((lattice.top + 1, cells), np.inf)
    cost[lattice.find_index(problem.speed), 0] = 0.0
    wait_cost = problem.wait_penalty * (lattice.cell_m / FINE.cell_m) * np.arange(cells)[::-1]
    choices: list[Int] = []
    settled_layer = _find_settled_layer(problem)
    for layer in range(len(problem.must_move)):
        if np.isfinite(cost[goals]).any():
            return _trace_back(problem, transitions, choices, _find_cheapest(cost, goals), reaches_goal=True)
        before = cost
        cost, choice = _advance_layer(cost, transitions, problem.blocked[layer * samples : (layer + 1) * samples])
        cost += wait_cost
        _forbid_states(cost, problem, layer)
        choices.append(choice)
        if not np.isfinite(cost).any():
            return None
        if layer > settled_layer and _is_stuck(before, cost):
            cost[1:] = np.inf
            break
    reaches_goal = bool(np.isfinite(cost[goals]).any())
    if not reaches_goal and len(problem.blocked_after):
        cost[_find_unstoppable(problem)] = np.inf
        if not np.isfinite(cost).any():
            return None
    furthest = np.arange(cells) == np.flatnonzero(np.isfinite(cost).any(axis=0))[-1]
    final = _find_cheapest(cost, goals if reaches_goal else furthest)
    return _trace_back(problem, transitions, choices, final, reaches_goal)


def _find_settled_layer(problem: SpeedProfileProblem) -> int:
    """Return the layer after which nothing that blocks cells changes any more; the last one on the fine lattice.

    A search that has got stuck is then over: long horizons are searched only as far as something happens.
    """
    last = len(problem.must_move)
    if not problem.lattice.has_exact_start or problem.ends_standing or not len(problem.blocked):
        return last
    changes = np.flatnonzero((problem.blocked != problem.blocked[-1]).any(axis=1))
    return (int(changes[-1]) // problem.lattice.samples + 1 if len(changes) else 0) + SETTLING_LAYERS


def _is_stuck(before: Float, after: Float) -> bool:
    """Return whether the furthest cell is the same in two layers, and a car can stand there.

    Or in the cell before: sums of cell and speed are all even or all odd.
    """
    first, second = (int(np.flatnonzero(np.isfinite(cost).any(axis=0))[-1]) for cost in (before, after))
    return first == second and bool(np.isfinite(after[0, max(first - 1, 0) : first + 1]).any())


def _advance_layer(cost: Float, transitions: Transitions, blocked: Bool) -> tuple[Float, Int]:
    """Return the costs of the next layer and the index of the move that leads to each state."""
    cells, reach = cost.shape[1], transitions.reach
    padded = np.full((len(cost), reach + cells), np.inf)
    padded[:, reach:] = cost
    options = sliding_window_view(padded, cells, axis=1)[transitions.before, reach - transitions.advance]
    options[transitions.is_illegal] = np.inf
    options += transitions.effort
    passed = np.concatenate((np.repeat(blocked[:, :1], reach, axis=1), blocked), axis=1)
    for sample in np.flatnonzero(blocked.any(axis=1)).tolist():
        window = sliding_window_view(passed[sample], cells)
        np.copyto(options, np.inf, where=window[reach - transitions.back[:, sample]])
    choice = options.argmin(0)
    return np.take_along_axis(options, choice[None], 0)[0], choice


def _forbid_states(cost: Float, problem: SpeedProfileProblem, layer: int) -> None:
    """Forbid standing too long, and speeds above the limit; a car that is too fast may reach the limit gently."""
    lattice = problem.lattice
    limits = np.maximum(problem.limits, round(problem.speed / lattice.speed_step) - 1 - layer)
    cost[np.arange(lattice.top + 1)[:, None] > limits[None, :]] = np.inf
    if problem.must_move[layer]:
        cost[0] = np.inf


def _find_unstoppable(problem: SpeedProfileProblem) -> Bool:
    """Return a mask (speeds, J): states from which a car cannot stop before a cell that stays blocked."""
    cells, lattice = len(problem.cells), problem.lattice
    speeds, braking = np.arange(lattice.top + 1), -PLANNED_BRAKING_MOVE
    stop = np.ceil(speeds * speeds / braking).astype(np.int64)
    count = np.concatenate(((0,), np.cumsum(problem.blocked_after)))
    ends = np.minimum(np.arange(cells) + stop[:, None] + 1, cells)
    return count[ends] > count[:-1]


def _find_cheapest(cost: Float, allowed: Bool) -> int:
    """Return the flat index of the cheapest allowed state."""
    return int(np.where(allowed, cost, np.inf).argmin())


def _trace_back(
    problem: SpeedProfileProblem, transitions: Transitions, choices: list[Int], state: int, reaches_goal: bool
) -> SpeedProfile:
    """Return the profile that ends in that state."""
    lattice, (index, cell) = problem.lattice, divmod(state, len(problem.cells))
    states = [(index, cell)]
    for choice in reversed(choices):
        move = int(choice[index, cell])
        index, cell = int(transitions.before[move, index]), cell - int(transitions.advance[move, index])
        states.append((index, cell))
    chain = np.array(states[::-1])
    s, speed = problem.lattice_s + chain[:, 1] * lattice.cell_m, chain[:, 0] * lattice.speed_step
    if lattice.has_exact_start:
        s[0], speed[0] = problem.start_s, problem.speed
    return SpeedProfile(s, speed, reaches_goal, lattice.step_s)


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
