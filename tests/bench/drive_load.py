"""Drives on one host: `python tests/bench/drive_load.py --drives 10 --drivers 2`.

One server with several drives of packaged scenarios, each with its own simulation process, and scripted drivers that
send an input with each frame over WebSockets of this machine. It prints the slowest clock (simulated by real time) and
the processor time of all processes of the host by second and drive, from which follows how many a machine carries.
"""

import asyncio
import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import click
from websockets.asyncio.client import connect

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))  # before this folder, whose server.py is another `server`
from testing.drive_server import DriveServer, serve_drive

from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import DT
from mdrive_sumo.scenario.suite import load_suite
from server.drive.protocol import DriveInput, FrameState, InputDevice, decode_frame, encode_input
from server.drive.simulation_process import SimulationProcess
from server.drive.simulation_values import DriveSetup

CONTROL = Control(0.15, 0.0, 0.0)
"""A gentle throttle: cars that stand would cost less."""


async def _drive(address: str, seconds: float, factors: list[float]) -> None:
    """Drive one CAV: an input for each frame. Append simulated by real time, over the time in which the clock ran."""
    number, first, last = 0, (0, 0.0), (0, 0.0)
    async with connect(address) as socket:
        await socket.send('{"do":"resume"}')
        begun = time.monotonic()
        while time.monotonic() - begun < seconds:
            message = await socket.recv()
            if isinstance(message, str):
                continue
            frame = decode_frame(message)
            if frame.state not in (FrameState.RUNNING, FrameState.SLOW):
                continue
            now = (frame.tick, time.monotonic())
            first, last = first if first[0] else now, now
            number += 1
            await socket.send(encode_input(DriveInput(InputDevice.SCRIPT, number, 0.0, CONTROL)))
    if last[1] > first[1]:
        factors.append((last[0] - first[0]) * DT / (last[1] - first[1]))


async def _drive_all(addresses: list[str], seconds: float) -> list[float]:
    factors: list[float] = []
    await asyncio.gather(*(_drive(address, seconds, factors) for address in addresses))
    return factors


def list_addresses(served: DriveServer) -> list[str]:
    """Return the WebSocket of each driver."""
    links = [link for name in served.host.list_drives() for link in served.host.list_links(name) if link.cav]
    tokens = [link.path.partition("token=")[2] for link in links]
    return [f"ws://127.0.0.1:{served.port}/socket?token={token}" for token in tokens]


def choose_scenarios(suite: str, drives: int, drivers: int) -> list[Any]:
    """Return scenarios of a suite with enough CAVs; again from the first one if there are too few."""
    fitting = [scenario for scenario in load_suite(suite) if len(scenario.egos) >= drivers]
    return [fitting[i % len(fitting)] for i in range(drives)]


def read_processor_s(pids: list[int]) -> float:
    """Return the processor time of processes and of their children that have ended [s]."""
    ticks = 0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        ticks += sum(map(int, fields[11:15]))
    return ticks / os.sysconf("SC_CLK_TCK")


def list_descendants(pid: int) -> list[int]:
    """Return a process and all below it that live."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found


@click.command()
@click.option("--suite", default="interdrive", show_default=True)
@click.option("--drives", default=10, show_default=True)
@click.option("--drivers", default=2, show_default=True, help="People in each drive.")
@click.option("--seconds", default=10.0, show_default=True)
def main(suite: str, drives: int, drivers: int, seconds: float) -> None:
    """Measure how many drives this machine carries."""
    scenarios = choose_scenarios(suite, drives, drivers)
    with tempfile.TemporaryDirectory() as folder:
        setups = [
            DriveSetup(one.id, Path(folder) / str(i), tuple(ego.id for ego in one.egos[:drivers]))
            for i, one in enumerate(scenarios)
        ]
        others = {f"drive-{i}": setup for i, setup in enumerate(setups[1:], 1)}
        with serve_drive(setups[0], make_simulation=SimulationProcess, others=others) as served:
            addresses = list_addresses(served)
            before, begun = read_processor_s(list_descendants(os.getpid())), time.monotonic()
            factors = asyncio.run(_drive_all(addresses, seconds))
            used_s = read_processor_s(list_descendants(os.getpid())) - before
            elapsed_s = time.monotonic() - begun
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    click.echo(
        json.dumps(
            {
                "cores": os.cpu_count(),
                "load": round(os.getloadavg()[0], 1),
                "drives": drives,
                "drivers": len(factors),
                "slowest clock": round(min(factors), 3),
                "processor s by s and drive": round(used_s / elapsed_s / drives, 3),
                "server and clients MB": round(memory_mb),
            }
        )
    )


if __name__ == "__main__":
    main()
