"""The figures of issue C's speed: a busy log through `mdrive-sumo convert`, and where the time goes.

Run it alone: python tests/bench/conversion.py
"""

import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
from testing.busy_log import make_busy_log

from real2sim.pipeline import scenario_builder
from real2sim.pipeline.log_conversion import convert_log
from real2sim.pipeline.log_source import LogSource

Row = tuple[str, float, str, str]
STEPS = {
    "clean": "clean_recording",
    "build_network": "build_network",
    "reconstruct": "reconstruct_tracks",
    "match": "match_track",
    "fit": "fit_traffic",
    "assessed": "assess_tracks",
    "closeness": "measure_traffic_fidelity",
}
"""Row of the table -> function of `scenario_builder` that is timed."""


def conversion_rows(folder: Path) -> Iterator[Row]:
    """10 s, 84 road users, 4 agents, on one core, netconvert included; memory is the peak of any process of it."""
    log, map_ = make_busy_log(folder)
    began = time.perf_counter()
    process = subprocess.Popen(
        (
            *(sys.executable, "-c", "from mdrive_sumo.cli import main; main()"),
            *("convert", "v2xpnp", log, "--map", map_, "--out", folder / "suite", "--workers", "1"),
        ),
        preexec_fn=lambda: os.sched_setaffinity(0, {0}),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)  # of this process and its own alone, whatever ran before it
    process.returncode = os.waitstatus_to_exitcode(status)
    yield "convert, log of 10 s, 84 road users, 4 agents, one core", time.perf_counter() - began, "s", "<= 2"
    yield "convert, memory of the largest process", used.ru_maxrss / 1024, "MB", "< 1000"
    yield from _step_rows(LogSource("v2xpnp", log, (map_,)), folder / "steps")


def _step_rows(log: LogSource, draft: Path) -> Iterator[Row]:
    spent: dict[str, float] = defaultdict(float)
    for name in STEPS.values():
        setattr(scenario_builder, name, _timed(name, getattr(scenario_builder, name), spent))
    began = time.perf_counter()
    convert_log(log, draft, scenario_builder.ConversionOptions())
    whole = time.perf_counter() - began
    yield from ((f"convert, of these {row}", spent[name], "s", "-") for row, name in STEPS.items())
    yield "convert, of these reading and writing", whole - sum(spent.values()), "s", "-"


def _timed(name: str, function: Callable[..., Any], spent: dict[str, float]) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        began = time.perf_counter()
        result = function(*arguments)
        spent[name] += time.perf_counter() - began
        return result

    return timed


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        for row in conversion_rows(Path(scratch)):
            sys.stdout.write(f"{row[0]:<66}{row[1]:>10.2f} {row[2]:<8}{row[3]}\n")
