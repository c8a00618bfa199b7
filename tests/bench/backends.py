"""What a kernel for each box costs a submission: `python tests/bench/backends.py ENVIRONMENTS [EACH]`.

Drives the sample agent of `mdrive-sumo init-agent` through EACH scenarios of each suite of the paper, in turns in boxes
of bubblewrap and of gVisor with files of their own. Prints the wall time, and what that makes for 225 scenarios.
ENVIRONMENTS is a folder with `python3.11-numpy` as `mdrive-sumo admin environment build` makes it.
"""

import shutil
import sys
import tempfile
import time
from pathlib import Path

import click

from mdrive_sumo.agent_process.child_process import AgentBox
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.scenario.suite import load_suite

SUITES = ("interdrive", "interaction", "v2xpnp")
BACKENDS = ("bubblewrap", "gvisor")
ALL = 225
SAMPLE = Path(__file__).parents[2] / "server" / "samples" / "agent"


def main() -> None:
    """Prints a line for each scenario, and the sums."""
    environment, each = Path(sys.argv[1]) / "python3.11-numpy", int((sys.argv[2:] or ["3"])[0])
    site = environment / "lib" / "python3.11" / "site-packages"
    spent_s = dict.fromkeys(BACKENDS, 0.0)
    count, boxes = 0, 0
    with tempfile.TemporaryDirectory() as made:
        Path(made).chmod(0o755)
        folder = Path(made) / "agent"
        shutil.copytree(SAMPLE, folder)
        config = {"config": f"/agent/config/{next((folder / 'config').iterdir()).name}"}
        for name in SUITES:
            suite = load_suite(name)
            chosen = suite.scenarios[:: max(1, len(suite.scenarios) // each)][:each]
            for scenario in chosen:
                count, boxes = count + 1, boxes + len(scenario.egos)
                words = [f"{scenario.id} ({len(scenario.egos)} CAVs)"]
                digests: set[str] = set()
                for backend in BACKENDS:
                    box = AgentBox(folder, str(environment / "bin" / "python"), site, backend, copies=MEMORY)
                    job = EpisodeJob(suite.folder, scenario.id, AgentSpec("/agent/agents.py:Agent", config, box=box))
                    since = time.perf_counter()
                    digests.add(run_job(job).digest)
                    took_s = time.perf_counter() - since
                    spent_s[backend] += took_s
                    words.append(f"{backend} {took_s:.1f} s")
                click.echo(", ".join((*words, "same digest" if len(digests) == 1 else "DIFFERENT DIGESTS")))
    for backend, total_s in spent_s.items():
        click.echo(
            f"{backend}: {total_s:.1f} s for {count} scenarios with {boxes} boxes;"
            f" {ALL} scenarios: {total_s / count * ALL / 60:.0f} minutes of one worker"
        )


if __name__ == "__main__":
    main()
