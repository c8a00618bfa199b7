"""The fastest conflict-free speed profile along a path, by dynamic programming in space and time.

The search runs on a `SpeedLattice`; which one depends on the speeds. Each layer holds only the cells between the first
and the last one that the car can have reached.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.planning.speed_lattice import FINE, Transitions, build_transitions
from mdrive_sumo.planning.speed_profile import SpeedProfile, SpeedProfileProblem

PLANNED_BRAKING_MOVE = -2
"""Change of speed [speed steps] in a step with which a car can always be expected to stop: 4 m/s2."""
SETTLING_LAYERS = 2
"""Layers after the last change before a search may be over."""


@dataclass(frozen=True, slots=True)
class _Layer:
    """Costs of the states (speeds, K) of K successive cells; all others are out of reach."""

    first: int
    """Number of the first cell."""
    cost: Float
    """(speeds, K), infinity where a state cannot be reached."""

    @property
    def end(self) -> int:
        """Number of the cell after the last one."""
        return self.first + self.cost.shape[1]

    def trim(self) -> "_Layer | None":
        """Return the layer without unreachable cells at both ends; None if no cell can be reached."""
        reached = np.flatnonzero(np.isfinite(self.cost).any(axis=0))
        if not len(reached):
            return None
        return _Layer(self.first + int(reached[0]), self.cost[:, reached[0] : reached[-1] + 1])

    def find_cheapest(self, first: int, end: int, speeds: int) -> tuple[int, int] | None:
        """Return speed and cell of the cheapest state in cells from `first` on up to `end`, of the lowest `speeds`.

        None if none can be reached. Ties go to the lower speed, then to the nearer cell.
        """
        low, high = max(first - self.first, 0), min(end, self.end) - self.first
        if low >= high:
            return None
        part = self.cost[:speeds, low:high]
        speed, cell = divmod(int(part.argmin()), high - low)
        return (speed, cell + low + self.first) if part[speed, cell] < np.inf else None


class _Search:
    """The constant parts of one search."""

    def __init__(self, problem: SpeedProfileProblem, transitions: Transitions) -> None:
        lattice, cells = problem.lattice, len(problem.cells)
        self._problem, self.transitions = problem, transitions
        reach = self.transitions.reach
        self._blocked = np.concatenate((np.repeat(problem.blocked[:, :1], reach, axis=1), problem.blocked), axis=1)
        """(T, reach + J): the cells behind cell 0 are blocked as that one is."""
        self._penalty: Float = np.where(self.transitions.is_illegal[..., None], np.inf, self.transitions.effort)
        self._wait_cost = problem.wait_penalty * (lattice.cell_m / FINE.cell_m) * np.arange(cells)[::-1]
        first, end, _ = problem.goals.indices(cells)
        self._goals = first, end, 1 if problem.ends_standing else lattice.top + 1
        self._speeds = np.arange(lattice.top + 1)[:, None]
        self._first_limit = round(problem.speed / lattice.speed_step) - 1

    def find_goal(self, layer: _Layer) -> tuple[int, int] | None:
        """Return speed and cell of the cheapest state that reaches the goal."""
        return layer.find_cheapest(*self._goals)

    def advance(self, layer: _Layer, number: int) -> tuple[_Layer, Int]:
        """Return the layer after layer `number`, and the index of the move that leads to each of its states."""
        transitions, first = self.transitions, layer.first
        count = min(layer.end + transitions.reach, len(self._problem.cells)) - first
        padded = np.full((len(layer.cost), transitions.reach + count), np.inf)
        padded[:, transitions.reach : transitions.reach + layer.end - first] = layer.cost
        views = sliding_window_view(padded, count, axis=1)
        options = views[transitions.before, transitions.reach - transitions.advance]
        options += self._penalty
        self._block(options, first, number)
        cost, choice = options.min(axis=0), options.argmin(axis=0)
        cost += self._wait_cost[first : first + count]
        self._forbid(cost, first, number)
        return _Layer(first, cost), choice

    def _block(self, options: Float, first: int, number: int) -> None:
        """Forbid the moves (moves, speeds, K) that end in cells from `first` on and pass blocked ones."""
        transitions, samples, count = self.transitions, self._problem.lattice.samples, options.shape[2]
        passed = self._blocked[number * samples : (number + 1) * samples, first : first + transitions.reach + count]
        for sample in np.flatnonzero(passed.any(axis=1)).tolist():
            windows = sliding_window_view(passed[sample], count)
            np.copyto(options, np.inf, where=windows[transitions.reach - transitions.back[:, sample]])

    def _forbid(self, cost: Float, first: int, number: int) -> None:
        """Forbid standing too long, and speeds above the limit; a car that is too fast may reach the limit gently."""
        limits = np.maximum(self._problem.limits[first : first + cost.shape[1]], self._first_limit - number)
        cost[self._speeds > limits] = np.inf
        if self._problem.must_move[number]:
            cost[0] = np.inf


def find_fastest_profile(problem: SpeedProfileProblem) -> SpeedProfile | None:
    """Return the profile that reaches the goal first, with the least squared acceleration among equals.

    If none reaches the goal in time: the one that gets furthest. None if all collide.
    """
    return search_profile(problem, build_transitions(problem.lattice))


@twin
def search_profile(problem: SpeedProfileProblem, transitions: Transitions, /) -> SpeedProfile | None:
    """Return `find_fastest_profile`, with the transitions of the problem's lattice."""
    search = _Search(problem, transitions)
    start = np.full((problem.lattice.top + 1, 1), np.inf)
    start[problem.lattice.find_index(problem.speed)] = 0.0
    layer, choices = _Layer(0, start), list[tuple[int, Int]]()
    settled_layer = _find_settled_layer(problem)
    for number in range(len(problem.must_move)):
        if (state := search.find_goal(layer)) is not None:
            return _trace_back(problem, search.transitions, choices, state, reaches_goal=True)
        before, (advanced, choice) = layer, search.advance(layer, number)
        choices.append((advanced.first, choice))
        trimmed = advanced.trim()
        if trimmed is None:
            return None
        layer = trimmed
        if number > settled_layer and _is_stuck(before, layer):
            layer.cost[1:] = np.inf
            break
    if (state := search.find_goal(layer)) is not None:
        return _trace_back(problem, search.transitions, choices, state, reaches_goal=True)
    if len(problem.blocked_after):
        layer.cost[_find_unstoppable(problem)[:, layer.first : layer.end]] = np.inf
    furthest = layer.trim()
    if furthest is None:
        return None
    state = furthest.find_cheapest(furthest.end - 1, furthest.end, problem.lattice.top + 1)
    assert state is not None, "the last cell of a trimmed layer can be reached"
    return _trace_back(problem, search.transitions, choices, state, reaches_goal=False)


def _find_settled_layer(problem: SpeedProfileProblem) -> int:
    """Return the layer after which nothing that blocks cells changes any more; the last one on the fine lattice.

    A search that has got stuck is then over: long horizons are searched only as far as something happens.
    """
    last = len(problem.must_move)
    if not problem.lattice.has_exact_start or problem.ends_standing or not len(problem.blocked):
        return last
    changes = np.flatnonzero((problem.blocked != problem.blocked[-1]).any(axis=1))
    return (int(changes[-1]) // problem.lattice.samples + 1 if len(changes) else 0) + SETTLING_LAYERS


def _is_stuck(before: _Layer, after: _Layer) -> bool:
    """Return whether the furthest cell is the same in two layers, and a car can stand there.

    Or in the cell before: sums of cell and speed are all even or all odd.
    """
    return before.end == after.end and bool(np.isfinite(after.cost[0, -2:]).any())


def _find_unstoppable(problem: SpeedProfileProblem) -> Bool:
    """Return a mask (speeds, J): states from which a car cannot stop before a cell that stays blocked."""
    cells, lattice = len(problem.cells), problem.lattice
    speeds, braking = np.arange(lattice.top + 1), -PLANNED_BRAKING_MOVE
    stop = np.ceil(speeds * speeds / braking).astype(np.int64)
    count = np.concatenate(((0,), np.cumsum(problem.blocked_after)))
    ends = np.minimum(np.arange(cells) + stop[:, None] + 1, cells)
    return count[ends] > count[:-1]


def _trace_back(
    problem: SpeedProfileProblem,
    transitions: Transitions,
    choices: list[tuple[int, Int]],
    state: tuple[int, int],
    reaches_goal: bool,
) -> SpeedProfile:
    """Return the profile that ends in a state (speed, cell); choices: by layer its first cell and the moves."""
    lattice, (index, cell) = problem.lattice, state
    states = [state]
    for first, choice in reversed(choices):
        move = int(choice[index, cell - first])
        index, cell = int(transitions.before[move, index]), cell - int(transitions.advance[move, index])
        states.append((index, cell))
    chain = np.array(states[::-1])
    s, speed = problem.lattice_s + chain[:, 1] * lattice.cell_m, chain[:, 0] * lattice.speed_step
    if lattice.has_exact_start:
        s[0], speed[0] = problem.start_s, problem.speed
    return SpeedProfile(s, speed, reaches_goal, lattice.step_s)
