"""Compare digests of episodes between machines, versions of Python and NumPy, and processor features.

    python -m tools.compare_platforms write digests.json      # here: drives the sample and notes its digests
    python -m tools.compare_platforms compare digests.json    # there: drives the same episodes and compares
    python -m tools.compare_platforms variants digests.json   # here, once more for each entry of VARIANTS

Needs only what the library needs (numpy, shapely, libsumo, ...), so a bare environment with another version is enough.
"""

import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np

import mdrive_sumo
from mdrive_sumo.agents.registry import AGENTS, HUMAN_AGENTS
from mdrive_sumo.contract import Observation, Reply
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.core.compiled import SWITCH
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.terminal import echo
from tools.tool_command import HELP

SCENARIOS = (
    "i05_ins_c_skewed_left",
    "i10_ins_ss_old_town_queue",
    "i12_ins_sl_old_town",
    "i16_ins_sl_skewed",
    "i22_ins_sr_boulevard",
    "i29_ins_rl_minor_road",
    "i32_ins_crosschange_main_street_pairs",
    "i35_ins_chaos_old_town",
    "i41_hw_merge_two_from_the_ramp",
    "i45_hw_c_before_the_exit",
    "blocked-lane_03",
    "crosswalk_05",
    "highway-merge_04",
    "major-minor_06",
    "pre-crash_07",
    "roundabout_02",
    "unprotected-left_08",
    "deadlock_05",
    "corridor_011",
    "crossing_032",
)
"""Of every bucket, with and without background traffic, pedestrians and props; i29 and i35 differed (decision 030)."""
DRIVING_AGENTS = sorted({*AGENTS} - {*HUMAN_AGENTS})
SAMPLE_AGENTS = ("sharing", "sharing+negotiation", "single", "idm", "omniscient")
LEVEL_3, LEVEL_4 = "AVX2 FMA3", "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL"
"""Names of NumPy up to 2.3; from 2.4 on X86_V3 and X86_V4. Names that NumPy does not know are left out."""
VARIANTS = {
    "NumPy without AVX-512": {"NPY_DISABLE_CPU_FEATURES": f"{LEVEL_4} X86_V4"},
    "NumPy without AVX2 and FMA": {"NPY_DISABLE_CPU_FEATURES": f"{LEVEL_3} {LEVEL_4} X86_V3 X86_V4"},
    "OpenBLAS for Zen": {"OPENBLAS_CORETYPE": "Zen"},
    "OpenBLAS for Nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "C library without FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX,-AVX512F"},
    "Python text instead of the compiled layer": {SWITCH: "off"},
}
"""Environments in which the same processor computes as another one would, or without the compiled layer."""
Digests = dict[str, str]


def drive(pairs: list[tuple[str, str]], seed: int = 0) -> Digests:
    """Return digest and bits of each (scenario, agent), by "scenario agent"; says how far it is on standard error."""
    found: Digests = {}
    for scenario, agent in pairs:
        bits = hashlib.blake2b(digest_size=8)
        episode = mdrive_sumo.simulate(scenario, note_bits(agent, bits.update), seed=seed)
        found[f"{scenario} {agent}"] = f"{episode.digest} {bits.hexdigest()}"
        echo(f"{len(found)} of {len(pairs)}: {scenario} {agent} {found[f'{scenario} {agent}']}", err=True)
    return found


def note_bits(agent: str, note: Callable[[bytes], None]) -> Callable[[Config], Any]:
    """Return a built-in agent that notes its own state, every detection and every plan, unrounded, in each tick.

    Recordings round to millimetres: their digests can agree for a long time although the numbers behind them do not.
    """

    def build(config: Config) -> Any:
        driver: Any = AGENTS[agent](config)
        act = driver.act

        def act_and_note(seen: Observation) -> Reply:
            reply: Reply = act(seen)
            note(np.array((seen.own.x, seen.own.y, seen.own.yaw, seen.own.speed)).tobytes())
            if seen.objects is not None:
                note(np.array((seen.objects.x, seen.objects.y, seen.objects.yaw, seen.objects.speed)).tobytes())
            note(reply.plan.points.tobytes() if reply.plan else repr(reply.control).encode())
            return reply

        driver.act = act_and_note
        return driver

    return build


def describe_platform() -> dict[str, str]:
    """Return what may decide the last digit."""
    model = [line for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines() if line.startswith("model name")]
    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "libc": " ".join(platform.libc_ver()),
        "processor": model[0].partition(":")[2].strip() if model else platform.machine(),
        "environment": " ".join(
            f"{name}={os.environ[name]}" for one in VARIANTS.values() for name in one if name in os.environ
        ),
    }


def find_differences(expected: Digests, found: Digests) -> list[str]:
    """Return the names whose digests differ, or that were not driven."""
    return [name for name, digest in expected.items() if found.get(name) != digest]


def limit_features(variant: dict[str, str]) -> dict[str, str]:
    """Return the variant with only those features that this NumPy may switch off."""
    from numpy._core._multiarray_umath import __cpu_dispatch__  # type: ignore[attr-defined]  # no public name

    names = {name: value for name, value in variant.items() if name != "NPY_DISABLE_CPU_FEATURES"}
    known = [one for one in variant.get("NPY_DISABLE_CPU_FEATURES", "").split() if one in __cpu_dispatch__]
    return names | ({"NPY_DISABLE_CPU_FEATURES": " ".join(known)} if known else {})


@click.group(context_settings=HELP)
def main() -> None:
    """Compare digests of episodes between platforms."""


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--scenario", "scenarios", multiple=True, help="Instead of the sample; may be repeated.")
@click.option("--agent", "agents", multiple=True, type=click.Choice(DRIVING_AGENTS), help="Likewise.")
def write(file: Path, scenarios: tuple[str, ...], agents: tuple[str, ...]) -> None:
    """Drive the sample and write its digests to FILE."""
    pairs = [(scenario, agent) for scenario in scenarios or SCENARIOS for agent in agents or SAMPLE_AGENTS]
    write_text(file, json.dumps({"platform": describe_platform(), "digests": drive(pairs)}, indent=1) + "\n")


@main.command()
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
def compare(file: Path) -> None:
    """Drive the episodes of FILE and compare; exit code 1 if one differs."""
    stored = json.loads(file.read_text("utf-8"))
    expected: Digests = stored["digests"]
    found = drive([(name.partition(" ")[0], name.partition(" ")[2]) for name in expected])
    differences = find_differences(expected, found)
    echo(f"written on: {stored['platform']}\ndriven on:  {describe_platform()}")
    for name in differences:
        echo(f"differs: {name}")
    echo(f"{len(expected) - len(differences)} of {len(expected)} digests agree")
    sys.exit(bool(differences))


@main.command()
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
def variants(file: Path) -> None:
    """Drive the episodes of FILE in each environment of VARIANTS; exit code 1 if one differs."""
    failed = False
    for title, variant in VARIANTS.items():
        command = [sys.executable, "-m", "tools.compare_platforms", "compare", str(file)]
        ended = subprocess.run(command, env=os.environ | limit_features(variant), stdout=subprocess.PIPE, text=True)
        echo(f"{title}: {ended.stdout.splitlines()[-1] if ended.stdout else 'failed'}")
        failed |= ended.returncode != 0
    sys.exit(failed)


if __name__ == "__main__":
    main()
