"""What an agent learns from the times of its requests about how long another thinks: `python tests/bench/lock_step.py`.

Two agents in processes of their own are asked tick by tick as in an episode, without a simulation between. One draws a
symbol a tick and waits so many steps before it answers; the other notes the time from request to request. The table
shows the mutual information of symbols and times, and that of symbols and shuffled times, which is the bias of the
estimate. Pauses are sleep, so the run costs little processor time.
Figures: docs/server-phases.md, "Timing between CAVs".
"""

import json
import math
import random
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from mdrive_sumo.agent_process.agent_connection import AgentLimits, ConnectionGroup
from mdrive_sumo.agent_process.child_process import AgentProgram
from mdrive_sumo.agent_process.remote_driver import RemoteDriver, open_agent_connection
from mdrive_sumo.contract import Observation, OwnState
from mdrive_sumo.core.bimodality import describe_modes
from mdrive_sumo.core.clock import IDEAL
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.loop.agent_scheduler import AgentScheduler
from mdrive_sumo.loop.request_pace import make_pace

SYMBOLS = 4
SHUFFLES = 50
AGENT = """
import json, random, time
from mdrive_sumo.contract import Control, Reply

class Agent:
    label = "single"

    def __init__(self, config):
        self.config, self.random, self.seen, self.last = config, random.Random(config["seed"]), [], None

    def sensors(self):
        return ()

    def start(self, briefing):
        pass

class Sender(Agent):
    def act(self, observation):
        symbol = self.random.randrange(self.config["symbols"])
        self.seen.append(symbol)
        time.sleep(symbol * self.config["step_s"])
        return self.done()

class Receiver(Agent):
    def act(self, observation):
        now = time.monotonic()
        self.seen.append(0.0 if self.last is None else now - self.last)
        self.last = now
        return self.done()

def done(self):
    if len(self.seen) == self.config["ticks"]:
        with open(self.config["out"], "w") as file:
            json.dump(self.seen, file)
    return Reply(control=Control(0.0, 0.0, 0.0))

Agent.done = done
"""


def drive(folder: Path, ticks: int, step_s: float, pace_s: float) -> tuple[list[int], list[float], float, float]:
    """The symbols, the times that the receiver saw after each, the duration [s], and D of the sender."""
    file, group = folder / "agents.py", ConnectionGroup()
    file.write_text(AGENT)
    with ExitStack() as stack:
        drivers: dict[str, RemoteDriver] = {}
        for name in ("Sender", "Receiver"):
            config = {"seed": 1, "symbols": SYMBOLS, "step_s": step_s, "ticks": ticks, "out": str(folder / name)}
            line = open_agent_connection(AgentProgram(f"{file}:{name}"), AgentLimits(pace_s=pace_s), None, group)
            drivers[name] = RemoteDriver(line, config)
            stack.callback(drivers[name].close)
        for driver in drivers.values():
            driver.sensors()
        scheduler = AgentScheduler(drivers, IDEAL, (), report, make_pace(pace_s))
        begin_s = time.monotonic()
        for tick in range(ticks):
            seen = Observation(tick, OwnState(0, 0, 0, 0, 0, 0, 0))
            scheduler.collect_replies(tick, dict.fromkeys(drivers, seen))
        took_s = time.monotonic() - begin_s
        modes = describe_modes(drivers["Sender"]._line.think_times_s)
    symbols, times = (json.loads((folder / name).read_text()) for name in ("Sender", "Receiver"))
    return symbols[:-1], times[1:], took_s, modes["d"] if modes else 0.0


def report(ego: str, error: AgentFailure) -> None:
    raise RuntimeError(f"{ego}: {error}")


def measure_information(symbols: Sequence[int], times: Sequence[float], width_s: float) -> float:
    """The mutual information [bit] of symbols and times, which are counted in classes of this width."""
    pairs = list(zip(symbols, (round(seconds / width_s) for seconds in times), strict=True))
    joint, first, second = Counter(pairs), Counter(symbol for symbol, _ in pairs), Counter(each for _, each in pairs)
    count = len(pairs)
    return sum(
        number / count * math.log2(number * count / (first[symbol] * second[each]))
        for (symbol, each), number in joint.items()
    )


def main(ticks: int) -> None:
    sys.stdout.write(
        "| step | pace | bit a tick | of shuffled times | bit a second | D of the sender |\n|---|---|---|---|---|---|\n"
    )
    for step_ms, pace_ms in ((5, 0), (20, 0), (50, 0), (5, 40), (20, 120), (50, 300), (20, 50), (20, 20)):
        with TemporaryDirectory() as name:
            symbols, times, took_s, separation = drive(Path(name), ticks, step_ms / 1000, pace_ms / 1000)
        order = random.Random(2)
        shuffled = [order.sample(times, len(times)) for _ in range(SHUFFLES)]
        width_s = step_ms / 2000
        found = measure_information(symbols, times, width_s)
        bias = sum(measure_information(symbols, each, width_s) for each in shuffled) / SHUFFLES
        net = max(0.0, found - bias)
        sys.stdout.write(
            f"| {step_ms} ms | {pace_ms or 'none'} | {found:.2f} | {bias:.2f} | {net * ticks / took_s:.1f} |"
            f" {separation:.1f} |\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
