"""An agent with a network of its own: ONNX Runtime in a box, with images of a camera."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from testing.sandbox_runs import needs_bubblewrap, reachable

from mdrive_sumo.agent_process.child_process import AgentBox, AgentProgram
from mdrive_sumo.agent_process.remote_driver import AgentLimits, RemoteDriver, open_agent_connection
from mdrive_sumo.agent_process.sandbox import BoxLimits
from mdrive_sumo.agents import learned
from mdrive_sumo.contract import CameraImage, Observation, OwnState

WEIGHTS = Path(learned.__file__).parent / "weights" / "tcp.onnx"
SIZE = (128, 450, 3)
AGENT = """
import numpy as np
import onnxruntime
from mdrive_sumo.contract import Control, Note, Reply, SensorSpec

class Driver:
    label = "single"
    def __init__(self, config):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self.session = onnxruntime.InferenceSession("/agent/tcp.onnx", options, providers=["CPUExecutionProvider"])
    def sensors(self): return (SensorSpec("camera", "front", options={"kind": "rgb", "width": 450, "height": 128}),)
    def start(self, briefing): pass
    def act(self, seen):
        front = seen.cameras["front"].pixels[None, None]
        answers = self.session.run(None, {"front": front, "navigation": np.zeros((1, 12), np.float32)})
        text = b"".join(answer.tobytes() for answer in answers).hex()
        return Reply(control=Control(0.1, 0.0, 0.0), notes=(Note("answer", text),))
"""


def compute_here(pixels: np.ndarray) -> str:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(WEIGHTS), options, providers=["CPUExecutionProvider"])
    navigation = np.zeros((1, 12), np.float32)
    answers = session.run(None, {"front": pixels[None, None], "navigation": navigation})
    return b"".join(np.asarray(answer).tobytes() for answer in answers).hex()


@pytest.mark.slow
@needs_bubblewrap
@pytest.mark.parametrize("backend", ["bubblewrap", "gvisor"])
def test_a_network_in_a_box_answers_camera_images_as_it_does_here(tmp_path: Path, backend: str) -> None:
    if backend == "gvisor" and shutil.which("runsc") is None:
        pytest.skip("needs gVisor's runsc")
    folder = reachable(tmp_path) / "agent"
    folder.mkdir()
    (folder / "agents.py").write_text(AGENT)
    shutil.copy(WEIGHTS, folder)
    limits = BoxLimits(memory_bytes=2**30)  # as of `python3.11-onnx`
    box = AgentBox(folder, sys.executable, Path(np.__file__).parents[1], backend, limits=limits)
    program = AgentProgram("/agent/agents.py:Driver", log=tmp_path / "log")
    remote = RemoteDriver(open_agent_connection(program, AgentLimits(tick_s=30.0), box), {})
    assert [sensor.kind for sensor in remote.sensors()] == ["camera"]
    for tick in range(2):
        pixels = np.random.default_rng(tick).integers(0, 256, SIZE, np.uint8)
        remote.ask(
            Observation(tick, OwnState(0, 0, 0, 0, 0, 0, 0), cameras={"front": CameraImage("rgb", pixels, 200.0)})
        )
        (note,) = remote.answer().notes
        assert note.text == compute_here(pixels)
    remote.close()
    assert remote.usage_record()["clean"]
