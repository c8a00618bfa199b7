"""All eight kinds of planted faults over hundreds of seeds: at least 98 % repaired, none silently, as printed."""

import sys

import numpy as np
import pytest
from testing.log_faults import PLANTS, planted
from testing.log_truth import observed, truth
from testing.map_faults import all_links, as_map
from testing.map_faults import plant as plant_in_map
from testing.network_samples import undirected

from mdrive_sumo.roads import list_packaged_networks, load_road_map
from tests.real2sim.clean.test_clean_faults import SHARE, rates
from tests.real2sim.network.test_lane_directions import repair

SEEDS = range(1000, 1200)


@pytest.mark.full
@pytest.mark.parametrize("kind", sorted(PLANTS))
def test_faults_of_a_log(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    logs = (planted(observed(truth(seed, 30, 6), seed, cavs=(0, 7)), seed, [kind]) for seed in SEEDS)
    share, silent = rates(logs)
    with capsys.disabled():
        sys.stdout.write(f"\n{kind}: {share[kind]:.2%} repaired, {len(silent)} silent\n")
    assert share[kind] >= SHARE
    assert silent == []


@pytest.mark.full
@pytest.mark.parametrize("kind", ["reversed lane", "missing link"])
def test_faults_of_a_map(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    """One kind at a time, a fifth of the lanes or links; what is repaired stands in the network's report by name.

    On a road without a junction no link tells directions: such networks are left out.
    """
    roads = [load_road_map(folder) for folder in list_packaged_networks().values()]
    maps = [undirected(as_map(one)) for one in roads if any(lane.successors for lane in one.driving)]
    total = good = wrong = 0
    for seed in SEEDS:
        clean = maps[seed % len(maps)]
        shares = (0.2, 0.0) if kind == "reversed lane" else (0.0, 0.2)
        faulty = plant_in_map(clean, np.random.default_rng(seed), *shares)
        inverted, added = repair(faulty.map)
        total += len(faulty.reversed) + len(faulty.removed)
        good += len(inverted & faulty.reversed) + len(added & faulty.removed)
        wrong += len(inverted - faulty.reversed) + len(added - all_links(clean.lanes))
    with capsys.disabled():
        sys.stdout.write(f"\n{kind}: {good / total:.2%} of {total} repaired, {wrong} wrongly\n")
    assert good >= SHARE * total
    assert wrong <= 0.01 * total
