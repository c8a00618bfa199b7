"""Real logs of ../shared/data by name. No tests in here."""

from collections.abc import Callable

from real2sim.readers.argoverse2 import read_argoverse2
from real2sim.readers.commonroad import read_commonroad
from real2sim.readers.interaction import read_interaction
from real2sim.readers.scenarionet import read_scenarionet
from real2sim.readers.time_grid import crop_recording
from real2sim.recording import Recording
from testing.shared_material import SHARED_DATA

LOGS = SHARED_DATA / "real_logs"
SENSOR = "3b3570b4-7b0b-3268-a571-b0889dbf40b6"
INTERACTION = (LOGS / "interaction", LOGS / "interaction/DR_USA_Intersection_EP0.osm")
WINDOW_S = 20
READ: dict[str, Callable[[], Recording]] = {
    "scene-0103": lambda: read_scenarionet(LOGS / "scenarionet_nuscenes/sd_nuscenes_v1.0-mini_scene-0103.pkl"),
    "scene-0757": lambda: read_scenarionet(LOGS / "scenarionet_nuscenes/sd_nuscenes_scene-0757.pkl"),
    "scene-1100": lambda: read_scenarionet(LOGS / "scenarionet_nuscenes/sd_nuscenes_v1.0-mini_scene-1100.pkl"),
    "av2-forecasting": lambda: read_argoverse2(LOGS / "argoverse2/forecasting"),
    "av2-sensor": lambda: read_argoverse2(LOGS / "argoverse2/sensor" / SENSOR),
    "peach": lambda: read_commonroad(LOGS / "commonroad/USA_Peach-4_8_T-1.xml"),
    "us101": lambda: read_commonroad(LOGS / "commonroad/USA_US101-3_3_T-1.xml"),
    "interaction": lambda: read_interaction(*INTERACTION),
}
SHORT_LOGS = tuple(name for name in READ if name != "interaction")


def read_window(start_s: float) -> Recording:
    """20 s of the recording of INTERACTION, which is minutes long."""
    return crop_recording("log", read_interaction(*INTERACTION), (start_s, start_s + WINDOW_S))
