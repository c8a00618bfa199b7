"""The fastest conflict-free speed profile along a path, by dynamic programming in space and time.

Lattice: a layer every 0.5 s, speeds in steps of 1 m/s, arc length in cells of 0.25 m. A step with an acceleration of
2·k m/s², k in (1, 0, -1, -2), changes speed v to v + k and moves the car 2v + k cells ahead, so every move ends exactly
on the lattice and nothing is rounded.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.planning.parameters import MARGINS, PROFILE, ProfileParameters, SafetyMargin
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath

STEP_S = 0.5
"""Duration of a step between two layers."""
MOVES = np.array((1, 0, -1, -2))
"""Change of speed [m/s] in a step."""
SAMPLES = 4
"""Samples of a step, 0.125 s apart, at which a cell must be free."""
SAMPLE_S = STEP_S / SAMPLES
TOP_SPEED = 10
"""[m/s]"""
MAX_CELLS_PER_STEP = 2 * TOP_SPEED


@dataclass(frozen=True)
class SpeedProfile:
    """Motion along a path: arc length (K,) [m] and speed (K,) [m/s] every `STEP_S`, linear speed in between."""

    s: Float
    speed: Float
    reaches_goal: bool
    """A profile that does not reach its goal is the best that could be found."""

    def get_stations(self, t: Float) -> Float:
        """Return the arc length (N,) [m] at times t >= 0 [s]; beyond the end at the last speed."""
        k = np.minimum((t / STEP_S).astype(np.int64), len(self.s) - 1)
        rest = t - k * STEP_S
        acceleration = np.append(np.diff(self.speed), 0.0)[k] / STEP_S
        return self.s[k] + self.speed[k] * rest + acceleration * (rest * rest) / 2

    def append(self, other: "SpeedProfile") -> "SpeedProfile":
        """Return this profile followed by another one that begins where this one ends."""
        s, speed = np.append(self.s, other.s[1:]), np.append(self.speed, other.speed[1:])
        return SpeedProfile(s, speed, other.reaches_goal)

    def extend_standstill(self, layers: int) -> "SpeedProfile":
        """Return this profile followed by that many steps of standing."""
        return replace(self, s=np.append(self.s, [self.s[-1]] * layers), speed=np.append(self.speed, [0.0] * layers))


@dataclass(frozen=True)
class SpeedProfileProblem:
    """The constraints of a speed profile. Cell j lies j · SPACING_M ahead of the car."""

    start_s: float
    """Arc length [m] of cell 0."""
    speed: float
    """[m/s] at the start."""
    cells: Int
    """(J,) index of the path's point at each cell."""
    limits: Int
    """(J,) highest speed [m/s] in each cell."""
    goals: slice
    """The cells in which the profile may end."""
    blocked: Bool
    """(T, J): whether a cell is occupied at time (row + 1) · SAMPLE_S; T is a multiple of SAMPLES."""
    must_move: Bool
    """(T / SAMPLES,) layers at which the car must not stand."""
    ends_standing: bool = False
    wait_penalty: float = 0.0
    """Cost of a step per cell that is still ahead, relative to the squared acceleration: without it, a car that cannot
    reach the goal yet drives when it is gentlest, which may be late."""

    @property
    def times(self) -> Float:
        """(T,) [s] from the start: when cells must be free."""
        return np.arange(1, len(self.blocked) + 1, dtype=np.float64) * SAMPLE_S

    def add_traffic(
        self,
        block: Callable[[SafetyMargin], Bool],
        min_margin: SafetyMargin = MARGINS.contact,
        parameters: ProfileParameters = PROFILE,
    ) -> "SpeedProfileProblem":
        """Return the problem with the cells that others block: block(margin) returns them, (T, J).

        Where the planning margin is violated from the start on (cars may start bumper to bumper, closer than a profile
        would ever bring them), only `min_margin` counts within the stopping distance until the margin is restored.
        """
        blocked = block(MARGINS.plan)
        near = parameters.forgiving_cells + int((self.speed * self.speed) / 8 / SPACING_M)
        violated = np.logical_and.accumulate(blocked[:, :near], axis=0)
        if violated.any():
            blocked[:, :near] &= ~violated | block(min_margin)[:, :near]
            blocked[:, 0] &= ~violated[:, 0]
        return replace(self, blocked=blocked)

    def require_stop(self, low: float, high: float) -> "SpeedProfileProblem":
        """Return the problem of stopping between two arc lengths [m]."""
        first, last = (max(math.ceil((s - self.start_s) / SPACING_M), 0) for s in (low, high))
        return replace(self, goals=slice(first, max(last, first + 1)), ends_standing=True)

    def build_remainder(self, part: SpeedProfile) -> "SpeedProfileProblem":
        """Return the problem that remains after a profile that ends standing."""
        layers, cells = len(part.s) - 1, round((part.s[-1] - self.start_s) / SPACING_M)
        return SpeedProfileProblem(
            start_s=float(part.s[-1]),
            speed=0.0,
            cells=self.cells[cells:],
            limits=self.limits[cells:],
            goals=slice(max((self.goals.start or 0) - cells, 0), None),
            blocked=self.blocked[layers * SAMPLES :, cells:],
            must_move=self.must_move[layers:],
        )


def build_free_road_problem(
    path: ReferencePath,
    speeds: Float,
    start: tuple[float, float],
    now_s: float,
    until_s: float,
    parameters: ProfileParameters = PROFILE,
) -> SpeedProfileProblem:
    """Return the problem of driving to the goal on a free road.

    speeds: (M,) limit [m/s] at each point of the path; start: arc length [m] and speed [m/s]; now_s, until_s: the
    present time and the time limit [s] of the episode.
    """
    goal = max(math.ceil((path.goal_s + parameters.beyond_goal_m - start[0]) / SPACING_M), 0)
    ahead = np.arange(goal + MAX_CELLS_PER_STEP + 1)
    cells = np.minimum(round(start[0] / SPACING_M) + ahead, len(path.xy) - 1)
    layers = max(int((until_s - now_s) / STEP_S), 1)
    return SpeedProfileProblem(
        start_s=start[0],
        speed=max(start[1], 0.0),
        cells=cells,
        limits=np.maximum(np.floor(speeds[cells] + 1e-6).astype(np.int64), 1),
        goals=slice(goal, None),
        blocked=np.zeros((layers * SAMPLES, len(cells)), dtype=np.bool_),
        must_move=_find_moving_layers(now_s, layers, parameters),
    )


def _find_moving_layers(now_s: float, layers: int, parameters: ProfileParameters) -> Bool:
    """Return a mask (layers,): at which layers a car must move so that it is never taken for blocked."""
    ends = now_s + (np.arange(layers) + 1) * STEP_S
    period_s = parameters.idle_period_s
    return (ends >= period_s) & (ends % period_s < parameters.idle_move_steps * STEP_S)


@dataclass(frozen=True)
class _Transitions:
    """The predecessors of every state (speed, cell); an index beyond all states stands for "none"."""

    sources: Int
    """(moves, speeds, cells) flat index of the previous state."""
    passed: Int
    """(samples, speeds, cells) cell at each sample of the step; cells before the start count as cell 0."""
    effort: Float
    """(moves, 1, 1)"""


def _build_transitions(cells: int) -> _Transitions:
    """Return the transitions on a lattice with that many cells."""
    speeds = np.arange(TOP_SPEED + 1)[None, :, None]
    cell = np.arange(cells)[None, None, :]
    before = speeds - MOVES[:, None, None]
    from_cell = cell - (speeds + before)
    legal = (before >= 0) & (before <= TOP_SPEED) & (from_cell >= 0)
    sources = np.where(legal, before * cells + from_cell, (TOP_SPEED + 1) * cells)
    back = 2 * (1 - np.arange(1, SAMPLES + 1) / SAMPLES)[:, None, None] * speeds
    passed = np.maximum(cell - np.round(back).astype(np.int64), 0)
    return _Transitions(sources, passed, (MOVES * MOVES).astype(np.float64)[:, None, None])


def find_fastest_profile(problem: SpeedProfileProblem) -> SpeedProfile | None:
    """Return the profile that reaches the goal first, with the least squared acceleration among equals.

    If none reaches the goal in time: the one that gets furthest. None if all collide.
    """
    cells, transitions = len(problem.cells), _build_transitions(len(problem.cells))
    goals = np.zeros((TOP_SPEED + 1, cells), dtype=np.bool_)
    goals[: 1 if problem.ends_standing else None, problem.goals] = True
    cost = np.full((TOP_SPEED + 1, cells), np.inf)
    cost[min(round(problem.speed), TOP_SPEED), 0] = 0.0
    choices: list[Int] = []
    for layer in range(len(problem.must_move)):
        if np.isfinite(cost[goals]).any():
            return _trace_back(problem, transitions, choices, _find_cheapest(cost, goals), reaches_goal=True)
        cost, choice = _advance_layer(cost, transitions, problem.blocked[layer * SAMPLES : (layer + 1) * SAMPLES])
        cost += problem.wait_penalty * np.arange(cells)[::-1]
        _forbid_states(cost, problem, layer)
        choices.append(choice)
        if not np.isfinite(cost).any():
            return None
    reaches_goal = bool(np.isfinite(cost[goals]).any())
    furthest = np.arange(cells) == np.flatnonzero(np.isfinite(cost).any(axis=0))[-1]
    final = _find_cheapest(cost, goals if reaches_goal else furthest)
    return _trace_back(problem, transitions, choices, final, reaches_goal)


def _advance_layer(cost: Float, transitions: _Transitions, blocked: Bool) -> tuple[Float, Int]:
    """Return the costs of the next layer and the index of the move that leads to each state."""
    options = np.append(cost.ravel(), np.inf)[transitions.sources] + transitions.effort
    choice = options.argmin(0)
    after = np.take_along_axis(options, choice[None], 0)[0]
    for row, passed in zip(blocked, transitions.passed, strict=True):
        if row.any():
            after[row[passed]] = np.inf
    return after, choice


def _forbid_states(cost: Float, problem: SpeedProfileProblem, layer: int) -> None:
    """Forbid standing too long, and speeds above the limit; a car that is too fast may reach the limit gently."""
    limits = np.maximum(problem.limits, round(problem.speed) - 1 - layer)
    cost[np.arange(TOP_SPEED + 1)[:, None] > limits[None, :]] = np.inf
    if problem.must_move[layer]:
        cost[0] = np.inf


def _find_cheapest(cost: Float, allowed: Bool) -> int:
    """Return the flat index of the cheapest allowed state."""
    return int(np.where(allowed, cost, np.inf).argmin())


def _trace_back(
    problem: SpeedProfileProblem, transitions: _Transitions, choices: list[Int], state: int, reaches_goal: bool
) -> SpeedProfile:
    """Return the profile that ends in that state."""
    cells = len(problem.cells)
    states = [state]
    for choice in reversed(choices):
        move = choice.ravel()[states[-1]]
        states.append(int(transitions.sources[move].ravel()[states[-1]]))
    chain = np.array(states[::-1])
    s, speed = problem.start_s + (chain % cells) * SPACING_M, (chain // cells).astype(np.float64)
    return SpeedProfile(s, speed, reaches_goal)


def build_braking_profile(problem: SpeedProfileProblem) -> SpeedProfile:
    """Return the profile that stops as soon as possible, whatever is in the way."""
    speeds = np.arange(round(problem.speed), -1, -2, dtype=np.float64)
    speeds = np.append(speeds, 0.0) if speeds[-1] else speeds
    steps = np.concatenate(((0.0,), (speeds[1:] + speeds[:-1]) / 2 * STEP_S))
    return SpeedProfile(problem.start_s + np.cumsum(steps), speeds, reaches_goal=False)
