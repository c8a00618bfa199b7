"""Processor time of environments for reinforcement learning: decisions and ticks per second of one CAV, and resets.

    python tests/bench/rl.py --scenario i25_ins_oppo_boulevard --view own --episodes 5

The first episode warms up and does not count. Actions are drawn anew for each decision: half throttle at most.
"""

import argparse
import json
import sys
import time

import numpy as np

from mdrive_sumo.rl.driving_actions import CHOICES
from mdrive_sumo.rl.env_settings import EnvSettings
from mdrive_sumo.rl.episode_process import LocalEpisodes
from mdrive_sumo.rl.slot_arrays import SlotStatus


def main() -> None:
    """Print one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="i25_ins_oppo_boulevard")
    parser.add_argument("--suite", default="interdrive@0")
    parser.add_argument("--view", default="own")
    parser.add_argument("--control", default="pedals")
    parser.add_argument("--ticks", type=int, default=4, help="ticks a decision")
    parser.add_argument("--episodes", type=int, default=5)
    args = parser.parse_args()
    settings = EnvSettings(
        suite=args.suite,
        scenarios=(args.scenario,),
        view=args.view,
        control=args.control,
        ticks_per_decision=args.ticks,
    )
    figures = {"resets": 0.0, "steps": 0.0, "ends": 0.0}
    decisions = 0
    episodes = LocalEpisodes(settings)
    draw = np.random.default_rng(0)  # of the bench, not of an episode
    for number in range(args.episodes + 1):
        since = time.process_time()
        episodes.reset(settings.choose_episode(0, number, {}))
        spent = {"resets": time.process_time() - since, "steps": 0.0, "ends": 0.0}
        alive, scores = 0, {}
        while not scores:
            _draw_actions(episodes, settings, draw)
            alive += int((episodes.arrays.status == SlotStatus.ACTIVE).sum())
            since = time.process_time()
            scores = episodes.step()
            spent["ends" if scores else "steps"] += time.process_time() - since
        if number:
            decisions += alive
            figures = {name: figures[name] + value for name, value in spent.items()}
    episodes.close()
    whole = sum(figures.values())
    sys.stdout.write(
        json.dumps(
            {
                "scenario": args.scenario,
                "view": args.view,
                "control": args.control,
                "ticks_per_decision": args.ticks,
                "cav_decisions_per_s": round(decisions / figures["steps"]),
                "cav_ticks_per_s": round(decisions * args.ticks / figures["steps"]),
                "cav_ticks_per_s_with_resets_and_scores": round(decisions * args.ticks / whole),
                "reset_ms": round(1000 * figures["resets"] / args.episodes, 1),
                "last_step_with_score_ms": round(1000 * figures["ends"] / args.episodes, 1),
            }
        )
        + "\n"
    )


def _draw_actions(episodes: LocalEpisodes, settings: EnvSettings, draw: np.random.Generator) -> None:
    arrays = episodes.arrays
    arrays.asked[:] = 1
    if settings.control in CHOICES:
        arrays.controls[:] = draw.integers(0, CHOICES[settings.control], arrays.controls.shape)
    else:
        arrays.controls[:] = draw.uniform((-0.1, -0.02), (0.5, 0.02), arrays.controls.shape)


if __name__ == "__main__":
    main()
