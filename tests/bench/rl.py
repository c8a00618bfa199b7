"""Speed of environments for reinforcement learning: ticks and decisions of CAVs per second, and resets.

    python tests/bench/rl.py --workers 2 --seconds 8
    python tests/bench/rl.py --highway-env PYTHON   # an interpreter with highway-env: its row in the same run

A row drives `VectorDrivingEnv` with pedals drawn anew for each decision, half throttle at most, resets and scores of
episodes included, and then resets the same scenarios in this process. "a CPU second" counts all processes: on a busy
machine it says more than the wall clock. The dense scenario is a training scenario, drawn into a scratch folder.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

HIGHWAY_S = 8.0
DENSE_INDEX = 15
"""Training scenario of seed 0 with 83 background vehicles and two CAVs; V2XPnP's scenarios have 84 on average."""
OPEN_SCENARIO = "i25_ins_oppo_boulevard"
"""Four CAVs, no background."""
RESETS = 8


class Case(NamedTuple):
    """A row of the table."""

    suite: str
    scenario: str
    view: str
    grid: str = ""
    control: str = "pedals"
    ticks: int = 4


def main() -> None:
    """Print the table, and one line of JSON a row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=8.0, help="of a row, by the wall clock")
    parser.add_argument("--highway-env", metavar="PYTHON", help="interpreter in which highway-env is installed")
    parser.add_argument("--only-highway-env", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.only_highway_env:
        _print(measure_highway_env())
        return
    with TemporaryDirectory() as scratch:
        for case in list_cases(Path(scratch)):
            _print(measure(case, args.workers, args.seconds))
    if args.highway_env:
        command = [args.highway_env, "-W", "ignore", __file__, "--only-highway-env"]
        subprocess.run(command, check=True)


def list_cases(scratch: Path) -> list[Case]:
    """Return the cases; the dense scenario is written into a folder."""
    from mdrive_sumo.learning.training_scenarios import build_training_scenario
    from mdrive_sumo.worlds.authoring.suite_folder import save_in_suite

    built = build_training_scenario("train", 0, DENSE_INDEX, scratch / "places")
    assert built is not None
    dense = (str(save_in_suite(*built, scratch / "dense")), built[0].id)
    free = ("interdrive@0", OPEN_SCENARIO)
    return [
        Case(*free, "own"),
        Case(*free, "privileged"),
        Case(*free, "own", ticks=1),
        Case(*free, "privileged", ticks=1),
        Case(*free, "own", control="targets"),
        Case(*free, "own", grid="raster"),
        Case(*free, "own", grid="lidar"),
        Case(*dense, "own"),
        Case(*dense, "privileged"),
    ]


def measure(case: Case, workers: int, seconds: float) -> dict[str, Any]:
    """Return the figures of a case."""
    import numpy as np

    from mdrive_sumo.rl import VectorDrivingEnv
    from mdrive_sumo.rl.driving_actions import CHOICES

    env = VectorDrivingEnv(
        workers, suite=case.suite, scenarios=[case.scenario], view=case.view, grid=case.grid, control=case.control,
        ticks_per_decision=case.ticks,
    )  # fmt: skip
    draw = np.random.default_rng(0)  # of the bench, not of an episode
    _, infos = env.reset(seed=0)
    for _ in range(20):  # the first episodes read maps
        env.step(env.action_space.sample())
    decisions = steps = 0
    begin, cpu = time.perf_counter(), _read_cpu(env.process_ids)
    while time.perf_counter() - begin < seconds:
        if case.control in CHOICES:
            actions = draw.integers(0, CHOICES[case.control], env.num_envs)
        else:
            actions = draw.uniform((-0.1, -0.02), (0.5, 0.02), (env.num_envs, 2)).astype(np.float32)
        decisions += int(infos["is_active"].sum())
        steps += 1
        *_, infos = env.step(actions)
    wall, cpu = time.perf_counter() - begin, _read_cpu(env.process_ids) - cpu
    settings = env.settings
    env.close()
    return {
        **case._asdict(),
        "suite": Path(case.suite).name,
        "workers": workers,
        "cav_ticks_per_s": round(decisions * case.ticks / wall),
        "cav_ticks_per_cpu_s": round(decisions * case.ticks / cpu),
        "cav_decisions_per_s": round(decisions / wall),
        "cav_decisions_per_cpu_s": round(decisions / cpu),
        "reset_cpu_ms": _measure_reset(settings),
        "load": round(os.getloadavg()[0], 1),
    }


def _measure_reset(settings: Any) -> float:
    """Return the processor time of a reset [ms], the first one left out."""
    from mdrive_sumo.rl.episode_process import LocalEpisodes

    episodes = LocalEpisodes(settings)
    episodes.reset(settings.choose_episode(0, 0, {}))
    begin = time.process_time()
    for number in range(1, RESETS + 1):
        episodes.reset(settings.choose_episode(0, number, {}))
    spent = time.process_time() - begin
    episodes.close()
    return round(1000 * spent / RESETS, 1)


def _read_cpu(process_ids: Sequence[int]) -> float:
    """Return the processor time [s] of this process and of these."""
    ticks = 0
    for process_id in process_ids:
        fields = Path(f"/proc/{process_id}/stat").read_text().rpartition(") ")[2].split()
        ticks += int(fields[11]) + int(fields[12])  # utime, stime: proc(5) counts from the state on
    return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")


def measure_highway_env() -> dict[str, Any]:
    """Return the figures of highway-env: four learners at its intersection, 20 Hz, decisions at 5 Hz, kinematics."""
    import gymnasium
    import highway_env  # pyright: ignore[reportMissingImports]
    import numpy as np

    gymnasium.register_envs(highway_env)
    config = {"controlled_vehicles": 4, "simulation_frequency": 20, "policy_frequency": 5, "initial_vehicle_count": 0,
              "spawn_probability": 0.0}  # fmt: skip
    env: Any = gymnasium.make("intersection-multi-agent-v0", config=config)
    draw = np.random.default_rng(0)
    env.reset(seed=0)
    resets: list[float] = []
    steps = 0
    begin, cpu = time.perf_counter(), time.process_time()
    while time.perf_counter() - begin < HIGHWAY_S:
        *_, terminated, truncated, _ = env.step(tuple(draw.integers(0, 3, 4).tolist()))
        steps += 1
        if terminated or truncated:
            since = time.process_time()
            env.reset()
            resets.append(time.process_time() - since)
    wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
    return {
        "scenario": f"highway-env {highway_env.__version__}, intersection-multi-agent-v0",
        "workers": 1,
        "cav_ticks_per_s": round(16 * steps / wall),
        "cav_ticks_per_cpu_s": round(16 * steps / cpu),
        "cav_decisions_per_s": round(4 * steps / wall),
        "cav_decisions_per_cpu_s": round(4 * steps / cpu),
        "reset_cpu_ms": round(1000 * sum(resets) / max(len(resets), 1), 1),
        "load": round(os.getloadavg()[0], 1),
    }


def _print(figures: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(figures) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
