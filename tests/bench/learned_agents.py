"""What agents that see and learn cost in a box: `python tests/bench/learned_agents.py ENVIRONMENTS [SCENARIO]`.

ENVIRONMENTS is a folder of environments as `mdrive-sumo admin environment build` makes them. A camera agent (the
network of `tcp` in ONNX Runtime, for every fourth tick), the sample of the sensor track (LiDAR, numpy) and a network of
PyTorch answer the same recorded observations.
"""

import shutil
import sys
import tempfile
from functools import partial
from pathlib import Path

import click
from sandbox import Probe, measure_start, recorded, row, times_ms

from mdrive_sumo.agent_process.child_process import AgentBox, AgentProgram
from mdrive_sumo.agent_process.remote_driver import AgentLimits, RemoteDriver, open_agent_connection
from mdrive_sumo.agent_process.sandbox import BoxLimits
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY

MEBIBYTE = 1024**2
STARTS = 5
ROOT = Path(__file__).parents[2]
WEIGHTS = ROOT / "mdrive_sumo" / "agents" / "learned" / "weights" / "tcp.onnx"
ONNX = """
import numpy as np
import onnxruntime
from mdrive_sumo.contract import Control, Plan, Reply, SensorSpec

OPTIONS = {"kind": "rgb", "width": 450, "height": 128, "fov_deg": 100.0, "every_ticks": 4, "x": 1.3, "z": 2.3}

class Agent:
    label = "single"
    def __init__(self, config):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self.session = onnxruntime.InferenceSession("/agent/tcp.onnx", options, providers=["CPUExecutionProvider"])
    def sensors(self): return (SensorSpec("camera", "front", options=OPTIONS), SensorSpec("speedometer"))
    def start(self, briefing): self.briefing = briefing
    def act(self, seen):
        if "front" in seen.cameras:
            navigation = np.zeros((1, 12), np.float32)
            pixels = np.asarray(seen.cameras["front"].pixels, np.uint8)[None, None]
            self.session.run(None, {"front": pixels, "navigation": navigation})
        return Reply(control=Control(0.3, 0.0, 0.0))
"""
TORCH = """
import numpy as np
import torch
from mdrive_sumo.contract import Control, Reply, SensorSpec
torch.set_num_threads(1)

class Agent:
    label = "single"
    def __init__(self, config):
        torch.manual_seed(0)
        layers = [torch.nn.Conv2d(4, 16, 5, 2), torch.nn.ReLU(), torch.nn.Conv2d(16, 32, 5, 2), torch.nn.ReLU()]
        self.network = torch.nn.Sequential(*layers, torch.nn.AdaptiveAvgPool2d(4), torch.nn.Flatten(),
                                           torch.nn.Linear(512, 2)).eval()
    def sensors(self): return (SensorSpec("lidar", "top"),)
    def start(self, briefing): pass
    def act(self, seen):
        grid = np.zeros((1, 4, 96, 96), np.float32)
        points = seen.lidar["top"].points if "top" in seen.lidar else np.zeros((0, 4), np.float32)
        cells = np.clip((points[:, :2] + 48).astype(int), 0, 95)
        grid[0, 0, cells[:, 0], cells[:, 1]] = 1.0
        with torch.inference_mode():
            out = self.network(torch.from_numpy(grid))[0]
        return Reply(control=Control(0.3, 0.0, float(out[0]) * 0.0))
"""


def open_driver(
    folder: Path, environment: Path, backend: str, memory_bytes: int, config: dict[str, str]
) -> RemoteDriver:
    """Start the agent of a folder in a box."""
    box = AgentBox(
        folder,
        python=str(environment / "bin" / "python"),
        site=environment / "lib" / "python3.11" / "site-packages",
        backend=backend,
        copies=MEMORY,
        limits=BoxLimits(memory_bytes=memory_bytes, cpu_s=600),
    )
    limits = AgentLimits(tick_s=60.0)
    return RemoteDriver(open_agent_connection(AgentProgram("/agent/agents.py:Agent"), limits, box), config)


def main() -> None:
    """Prints a table: start until the sensors are declared, and ticks, for each agent and backend."""
    environments, scenario = Path(sys.argv[1]), (sys.argv[2:] or ["i01"])[0]
    backends = ["bubblewrap", *(["gvisor"] if shutil.which("runsc") else [])]
    with tempfile.TemporaryDirectory() as made:
        Path(made).chmod(0o755)
        agents = (
            ("camera, network of `tcp` (ONNX Runtime)", ONNX, "python3.11-onnx", 1024, {}),
            ("LiDAR, sample (numpy)", "", "python3.11-numpy", 512, {"config": "/agent/config/default.json"}),
            ("LiDAR, small network (PyTorch)", TORCH, "python3.11-torch-cpu", 2048, {}),
        )
        click.echo("| [ms] | p10 | p50 | p99 |\n|---|---|---|---|")
        for number, (what, source, name, memory_mib, config) in enumerate(agents):
            if not (environments / name).is_dir():
                continue
            folder = Path(made) / str(number)
            if source:
                folder.mkdir()
                (folder / "agents.py").write_text(source)
                shutil.copy(WEIGHTS, folder)
            else:
                shutil.copytree(ROOT / "server" / "samples" / "lidar", folder)
                config = {"config": f"/agent/config/{next((folder / 'config').iterdir()).name}"}
            makers = {
                backend: partial(open_driver, folder, environments / name, backend, memory_mib * MEBIBYTE, config)
                for backend in backends
            }
            first = makers[backends[0]]()
            sensors = first.sensors()
            first.close()
            probe: Probe = recorded(scenario, sensors)
            for backend, make in makers.items():
                click.echo(row(f"{what}: start, {backend}", [measure_start(make)[0] for _ in range(STARTS)]))
                click.echo(row(f"{what}: tick, {backend}", times_ms(make(), probe)))


if __name__ == "__main__":
    main()
