"""When may a car be where on its path: the fastest speed profile that meets no one, by dynamic programming.

Lattice: a layer every 0.5 s, speeds in steps of 1 m/s, arc length in cells of 0.25 m. A step of acceleration
2·k m/s² with k in (1, 0, -1, -2) takes speed v to v + k and the car 2v + k cells ahead, so every move ends exactly
on the lattice and nothing is rounded.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.planning.path import SPACING_M, Path
from mdrive_sumo.planning.path_overlap import PLAN_MARGIN, TOUCHING, Margin

STEP_S = 0.5
MOVES = np.array((1, 0, -1, -2))
"""Change of speed [m/s] in a step."""
SAMPLES = 4
"""Moments of a step, 0.125 s apart, at which a cell must be free."""
SAMPLE_S = STEP_S / SAMPLES
TOP_SPEED = 10
"""[m/s]"""
FURTHEST = 2 * TOP_SPEED
"""Most cells that a step can go."""
ARRIVED_M = 1.0
"""How far beyond the goal a profile ends: the goal must be passed."""
NEAR_CELLS = 6
"""How far ahead of a standing car, besides stopping distance, a violated margin is forgiven."""
IDLE_S = 24.0
"""A CAV that stands for 30 s is out (protocol 7.5): at every multiple of this time it moves."""


@dataclass(frozen=True)
class Profile:
    """Motion along a path: arc length (K,) [m] and speed (K,) [m/s] every `STEP_S`, linear speed in between."""

    s: Float
    speed: Float
    arrives: bool
    """Whether it reaches its goal; a profile that does not is the best that could be found."""

    def at(self, t: Float) -> Float:
        """Arc length (N,) [m] at times t >= 0 [s]; beyond the end it goes on at the last speed."""
        k = np.minimum((t / STEP_S).astype(np.int64), len(self.s) - 1)
        rest = t - k * STEP_S
        acceleration = np.append(np.diff(self.speed), 0.0)[k] / STEP_S
        return self.s[k] + self.speed[k] * rest + acceleration * rest**2 / 2

    def then(self, other: "Profile") -> "Profile":
        """This one followed by another, which begins where this one ends."""
        s, speed = np.append(self.s, other.s[1:]), np.append(self.speed, other.speed[1:])
        return Profile(s, speed, other.arrives)

    def held(self, layers: int) -> "Profile":
        """The same and then standing for so many steps."""
        return replace(self, s=np.append(self.s, [self.s[-1]] * layers), speed=np.append(self.speed, [0.0] * layers))


@dataclass(frozen=True)
class Task:
    """What a profile must respect. Cell j lies j · SPACING_M ahead of where the car is."""

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
    """(T, J): blocked at time (row + 1) · SAMPLE_S; T is a multiple of SAMPLES."""
    moving: Bool
    """(T / SAMPLES,) layers at which the car must not stand."""
    stop: bool = False
    """Whether the profile ends standing."""
    haste: float = 0.0
    """What every step costs for each cell that is still ahead, against the squares of accelerations: with none, who
    cannot arrive yet drives when it is gentlest, which may be late."""

    @property
    def times(self) -> Float:
        """(T,) [s] from the start: when cells must be free."""
        return np.arange(1, len(self.blocked) + 1, dtype=np.float64) * SAMPLE_S

    def among(self, block: Callable[[Margin], Bool], least: Margin = TOUCHING) -> "Task":
        """The same task where others block cells: block(margin) tells which, (T, J).

        Where the plan's margin is violated from the start on (cars may start bumper to bumper, closer than a profile
        would ever bring them), only the least margin counts within stopping distance until the margin is whole.
        """
        blocked = block(PLAN_MARGIN)
        near = NEAR_CELLS + int(self.speed**2 / 8 / SPACING_M)
        violated = np.logical_and.accumulate(blocked[:, :near], axis=0)
        if violated.any():
            blocked[:, :near] &= ~violated | block(least)[:, :near]
            blocked[:, 0] &= ~violated[:, 0]
        return replace(self, blocked=blocked)

    def halted_at(self, low: float, high: float) -> "Task":
        """The task of standing somewhere between two arc lengths [m]."""
        first, last = (max(math.ceil((s - self.start_s) / SPACING_M), 0) for s in (low, high))
        return replace(self, goals=slice(first, max(last, first + 1)), stop=True)

    def after(self, part: Profile) -> "Task":
        """What is left when a profile that ends standing has been driven."""
        layers, cells = len(part.s) - 1, round((part.s[-1] - self.start_s) / SPACING_M)
        return Task(
            start_s=float(part.s[-1]),
            speed=0.0,
            cells=self.cells[cells:],
            limits=self.limits[cells:],
            goals=slice(max((self.goals.start or 0) - cells, 0), None),
            blocked=self.blocked[layers * SAMPLES :, cells:],
            moving=self.moving[layers:],
        )


def task_along(path: Path, speeds: Float, start: tuple[float, float], now_s: float, until_s: float) -> Task:
    """The task of driving on to the goal on a free road.

    speeds: (M,) limit [m/s] at each point of the path; start: arc length [m] and speed [m/s].
    """
    goal = max(math.ceil((path.goal_s + ARRIVED_M - start[0]) / SPACING_M), 0)
    ahead = np.arange(goal + FURTHEST + 1)
    cells = np.minimum(round(start[0] / SPACING_M) + ahead, len(path.xy) - 1)
    layers = max(int((until_s - now_s) / STEP_S), 1)
    return Task(
        start_s=start[0],
        speed=max(start[1], 0.0),
        cells=cells,
        limits=np.maximum(np.floor(speeds[cells] + 1e-6).astype(np.int64), 1),
        goals=slice(goal, None),
        blocked=np.zeros((layers * SAMPLES, len(cells)), dtype=np.bool_),
        moving=_moving(now_s, layers),
    )


def _moving(now_s: float, layers: int) -> Bool:
    """The layers (layers,) at which a car must move: 1.5 s in every `IDLE_S`."""
    ends = now_s + (np.arange(layers) + 1) * STEP_S
    return (ends >= IDLE_S) & (ends % IDLE_S < 3 * STEP_S)


@dataclass(frozen=True)
class _Tables:
    """Where each state (speed, cell) can come from; one index beyond all states means "nowhere"."""

    sources: Int
    """(moves, speeds, cells) flat index of the state before."""
    passed: Int
    """(samples, speeds, cells) cell at each sample of the step; cells before the start count as cell 0."""
    effort: Float
    """(moves, 1, 1)"""


def _tables(cells: int) -> _Tables:
    speeds = np.arange(TOP_SPEED + 1)[None, :, None]
    cell = np.arange(cells)[None, None, :]
    before = speeds - MOVES[:, None, None]
    from_cell = cell - (speeds + before)
    legal = (before >= 0) & (before <= TOP_SPEED) & (from_cell >= 0)
    sources = np.where(legal, before * cells + from_cell, (TOP_SPEED + 1) * cells)
    back = 2 * (1 - np.arange(1, SAMPLES + 1) / SAMPLES)[:, None, None] * speeds
    passed = np.maximum(cell - np.round(back).astype(np.int64), 0)
    return _Tables(sources, passed, (MOVES**2).astype(np.float64)[:, None, None])


def fastest(task: Task) -> Profile | None:
    """The profile that arrives first, gentlest among equals; the furthest one if none arrives; None if all collide."""
    cells, tables = len(task.cells), _tables(len(task.cells))
    goals = np.zeros((TOP_SPEED + 1, cells), dtype=np.bool_)
    goals[: 1 if task.stop else None, task.goals] = True
    cost = np.full((TOP_SPEED + 1, cells), np.inf)
    cost[min(round(task.speed), TOP_SPEED), 0] = 0.0
    choices: list[Int] = []
    for layer in range(len(task.moving)):
        if np.isfinite(cost[goals]).any():
            return _trace(task, tables, choices, _best(cost, goals), arrives=True)
        cost, choice = _advanced(cost, tables, task.blocked[layer * SAMPLES : (layer + 1) * SAMPLES])
        cost += task.haste * np.arange(cells)[::-1]
        _forbid(cost, task, layer)
        choices.append(choice)
        if not np.isfinite(cost).any():
            return None
    arrives = bool(np.isfinite(cost[goals]).any())
    furthest = np.arange(cells) == np.flatnonzero(np.isfinite(cost).any(axis=0))[-1]
    return _trace(task, tables, choices, _best(cost, goals if arrives else furthest), arrives)


def _advanced(cost: Float, tables: _Tables, blocked: Bool) -> tuple[Float, Int]:
    """Costs of the next layer and which move led to each state."""
    options = np.append(cost.ravel(), np.inf)[tables.sources] + tables.effort
    choice = options.argmin(0)
    after = np.take_along_axis(options, choice[None], 0)[0]
    for row, passed in zip(blocked, tables.passed, strict=True):
        if row.any():
            after[row[passed]] = np.inf
    return after, choice


def _forbid(cost: Float, task: Task, layer: int) -> None:
    """Rules out standing too long, and speeds above the limit, which a car that is too fast may reach gently."""
    limits = np.maximum(task.limits, round(task.speed) - 1 - layer)
    cost[np.arange(TOP_SPEED + 1)[:, None] > limits[None, :]] = np.inf
    if task.moving[layer]:
        cost[0] = np.inf


def _best(cost: Float, wanted: Bool) -> int:
    """Flat index of the cheapest wanted state."""
    return int(np.where(wanted, cost, np.inf).argmin())


def _trace(task: Task, tables: _Tables, choices: list[Int], state: int, arrives: bool) -> Profile:
    cells = len(task.cells)
    states = [state]
    for choice in reversed(choices):
        move = choice.ravel()[states[-1]]
        states.append(int(tables.sources[move].ravel()[states[-1]]))
    chain = np.array(states[::-1])
    return Profile(task.start_s + (chain % cells) * SPACING_M, (chain // cells).astype(np.float64), arrives)


def braking(task: Task) -> Profile:
    """Standing as soon as possible, whoever is in the way."""
    speeds = np.arange(round(task.speed), -1, -2, dtype=np.float64)
    speeds = np.append(speeds, 0.0) if speeds[-1] else speeds
    ways = np.concatenate(((0.0,), (speeds[1:] + speeds[:-1]) / 2 * STEP_S))
    return Profile(task.start_s + np.cumsum(ways), speeds, arrives=False)
