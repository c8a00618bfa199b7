"""Drive drawn traffic for 30 s on places of every kind: contacts, vehicles that never depart, time of a drawing.

PYTHONPATH=tests python tests/bench/drawn_traffic.py [SEEDS]
"""

import random
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from testing.drawn_drives import drive_drawn, place_roads

from mdrive_sumo.worlds.traffic import draw_traffic, find_demand

DEMANDS = {
    "crossing": ("town-busy", "town-quiet"),
    "roundabout": ("town-busy",),
    "town_block": ("town-quiet", "town-busy", "old-town"),
    "car_park": ("town-busy",),
    "driveways": ("town-quiet",),
    "corridor": ("arterial", "town-busy"),
    "motorway_merge": ("motorway",),
    "motorway_exit": ("motorway",),
    "motorway_weave": ("motorway",),
    "lane_drop": ("motorway",),
}
ENTERS_S = 25.0
"""[s] Vehicles that depart later may still wait at the end."""


def main(seeds: int) -> None:
    """Print the totals."""
    first_ms, drives, vehicles, people, never = list[float](), 0, 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for kind, demands in DEMANDS.items():
            for seed in range(1, seeds + 1):
                roads = place_roads(kind, seed, Path(folder))
                for demand in demands:
                    began = time.process_time()
                    draw_traffic(roads, (), (), find_demand(demand), random.Random(0))
                    first_ms.append((time.process_time() - began) * 1e3)
                    drive = drive_drawn(roads, demand, seed)
                    due = [one.id for one in drive.traffic.vehicles if one.depart_s < ENTERS_S]
                    never += len(set(due) - set(drive.driven_m))
                    drives, vehicles = drives + 1, vehicles + len(drive.traffic.vehicles)
                    people += sum(actor.kind == "pedestrian" for actor in drive.traffic.actors)
                    for pair in sorted(drive.contacts):
                        sys.stdout.write(f"contact: {kind} {seed} {demand}: {' and '.join(pair)}\n")
    sys.stdout.write(
        f"{drives} drives, {vehicles} vehicles, {people} people; {never} vehicles never departed\n"
        f"a drawing takes {sum(first_ms) / len(first_ms):.0f} ms on average, {max(first_ms):.0f} ms at most\n"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 6)
