"""The search for the cheapest chain of lanes against brute force, and shortest ways between lanes."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.roads import list_packaged_networks, load_road_map
from real2sim.match.lane_candidates import load_candidate_index
from real2sim.match.lane_chain import (
    DETOUR_M,
    LANE_CHANGE_M,
    compute_emission_cost,
    compute_transition_cost,
    find_best_chain,
)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_the_chain_is_the_cheapest_of_all(seed: int) -> None:
    """Against every combination of candidates of a few key frames."""
    roads = load_road_map(list_packaged_networks()["town_crossing"])
    rng = np.random.default_rng(seed)
    index = load_candidate_index(roads)
    ways = [one for one in roads.driving if one.junction]
    through = ways[int(rng.integers(len(ways)))].centre
    xy = np.array([through.at(s) for s in np.linspace(-6.0, through.length + 6.0, 4)]) + rng.normal(0, 1.0, (4, 2))
    yaw = np.array([through.yaw_at(s) for s in np.linspace(0.0, through.length, 4)])
    near = index.find_candidates(xy, yaw, 3.0)
    keys = [int(k) for k in np.unique(near.point)]
    rows, hops = find_best_chain(index, near, keys, xy)

    def cost(chain: tuple[int, ...]) -> float:
        total = float(compute_emission_cost(near.offset[list(chain)], near.turn[list(chain)]).sum())
        for a, b in itertools.pairwise(chain):
            driven = float(np.hypot(*np.diff(xy[near.point[a] : near.point[b] + 1], axis=0).T).sum())
            start, goal = (roads.driving[near.lane[row]].id for row in (a, b))
            hop = index.find_paths(start, driven + DETOUR_M, LANE_CHANGE_M).get(goal)
            along = 0.0 if hop is None else hop.length + float(near.s[b] - near.s[a])
            total += 60.0 if hop is None else min(compute_transition_cost(along, driven, hop.lane_changes), 60.0)
        return total

    layers = [np.flatnonzero(near.point == key).tolist() for key in keys]
    assert cost(tuple(rows)) == pytest.approx(min(cost(chain) for chain in itertools.product(*layers)))
    assert len(hops) == len(rows) - 1


def test_hops_are_the_shortest_ways() -> None:
    roads = load_road_map(list_packaged_networks()["boulevard"])
    index = load_candidate_index(roads)
    start = next(one.id for one in roads.driving if not one.junction and one.left and one.successors)
    for goal, hop in index.find_paths(start, 400.0, LANE_CHANGE_M).items():
        assert (hop.lanes[0], hop.lanes[-1]) == (start, goal)
        steps = list(itertools.pairwise(hop.lanes))
        ahead = [roads.lanes[a].centre.length for a, b in steps if b in roads.lanes[a].successors]
        assert hop.length == pytest.approx(sum(ahead))
        assert hop.lane_changes == len(steps) - len(ahead)
    assert {goal: hop.length for goal, hop in index.find_paths(start, 1.0, LANE_CHANGE_M).items()}[start] == 0.0
