"""What of the maps of senders a receiver has when it fuses: budgets, and the radios of the benchmark over a frame.

A surrogate of a drive: the cars of a frame stand where they are while the radio model (docs/radio.md) sends their maps
for a second and a half. Links are in line of sight or behind the frame's vehicles; frames do not know buildings, nor
other stations than senders. Rhythm and budget are those of the agents that drive with these detectors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.agents.learned.fusion_spec import DELAYS_TICKS, MAP_PACKETS, MAP_TICKS, WAIT_TICKS
from mdrive_sumo.core import portable
from mdrive_sumo.core.clock import TICKS_PER_SECOND
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.seeding import draw_first_uniform
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.sensing.lidar_world import CAR_M, assume_vehicle_heights
from mdrive_sumo.sensing.link_classes import classify_links
from mdrive_sumo.v2x.radio.path_loss import RadioEnvironment
from mdrive_sumo.v2x.radio.radio_medium import RadioMedium, Transmission
from mdrive_sumo.v2x.radio.radio_scene import RadioScene
from mdrive_sumo.v2x.radio.radio_settings import RadioProfile, RadioSettings

WARM_UP_MAPS = 7
"""Maps that were sent before, so that loads, which the radio measures over a second, and queues are settled."""
CAM_BYTES = 29
"""A CAM goes before each map; docs/v2x.md has its bytes."""
SAME_CAR_M = 1.0
"""A box nearer than this to a sender's pose is the sender's own."""


@dataclass(frozen=True, slots=True)
class SharingChannel:
    """A way to share maps."""

    name: str
    radio: RadioProfile | None = None
    """None: everything arrives at once."""
    packets: int | None = None
    """Of a map, the most confident tiles first; None: all."""


CHANNELS = (
    SharingChannel("ideal"),
    # Congestion control of an empty road lets a full packet of ITS-G5 go every 71 ms, one of LTE-V2X every 100 ms: more
    # packets fill the queue with maps that are too old, CAMs go besides, and nothing arrives in time.
    SharingChannel("its-g5", RadioProfile.ITS_G5, MAP_PACKETS),
    SharingChannel("lte-v2x", RadioProfile.LTE_V2X, 1),
)
BUDGETS = (
    SharingChannel("1 packet", None, 1),
    SharingChannel("2 packets", None, 2),
    SharingChannel("4 packets", None, 4),
)
"""Budgets without any loss, beside `ideal`."""


@dataclass(frozen=True, slots=True)
class ArrivedMap:
    """What a receiver has of one sender."""

    delay: int
    """Index into DELAYS_TICKS: how much older than the own scan the map is."""
    packets: tuple[int, ...]
    """Which of its packets arrived."""


Sizes = Mapping[int, Mapping[int, Sequence[int]]]
"""Bytes of the packets of each map: by car and by index into DELAYS_TICKS."""


def list_map_delays(channel: SharingChannel) -> tuple[int, ...]:
    """Return indices into DELAYS_TICKS of the maps that can be the newest, the newest first."""
    ages = (0,) if channel.radio is None else tuple(range(0, DELAYS_TICKS[-1] + 1, MAP_TICKS))
    return tuple(DELAYS_TICKS.index(age) for age in ages)


def find_arrived(frames: FusionFrames, row: int, channel: SharingChannel, sizes: Sizes) -> dict[int, ArrivedMap]:
    """Return what the own car has of each sender of a frame when it fuses; senders of which nothing came are left out.

    sizes: of all cars of the frame, the own one included, which sends as well. A car has no map of a delay where it has
    no scan. The same frame, channel and sizes give the same fate in any data set.
    """
    if channel.radio is None:
        return {
            car: ArrivedMap(0, tuple(range(len(of_car[0])))) for car, of_car in sizes.items() if car and of_car.get(0)
        }
    now = WARM_UP_MAPS * MAP_TICKS
    cars = sorted(sizes)
    scene = _build_scene(frames, row, cars)
    medium = RadioMedium(RadioSettings(channel.radio), RadioEnvironment.URBAN, seed=0)
    key = channel.name, frames.places[frames.place[row]], int(frames.episode[row]), int(frames.tick[row])
    arrived: dict[int, dict[int, list[int]]] = {car: {} for car in cars if car}
    for tick in range(0, now + 1, MAP_TICKS):
        age = now - tick
        delay = DELAYS_TICKS.index(age) if age in DELAYS_TICKS else len(DELAYS_TICKS) - 1
        sent: list[tuple[int, int]] = []
        transmissions: list[Transmission] = []
        for car in cars:
            packets = _find_sizes(sizes[car], delay)
            for i, size in enumerate((CAM_BYTES, *packets)):
                luck = draw_first_uniform(0, "fusion channel", *key, car, age, i)
                receivers = (("0",), (luck,)) if car else ((), ())
                transmissions.append(Transmission(str(car), size, *receivers))
                sent.append((car, i - 1))
        found = medium.transmit(tick, scene, transmissions)
        if age not in DELAYS_TICKS:
            continue
        for (car, packet), reception in zip(sent, found, strict=True):
            is_in_time = reception.arrival_s * TICKS_PER_SECOND <= now + WAIT_TICKS and not reception.losses
            if car and packet >= 0 and is_in_time and sizes[car].get(delay):
                arrived[car].setdefault(delay, []).append(packet)
    return {
        car: ArrivedMap(newest := min(by_delay), tuple(by_delay[newest]))
        for car, by_delay in arrived.items()
        if by_delay
    }


def _find_sizes(of_car: Mapping[int, Sequence[int]], delay: int) -> Sequence[int]:
    """Return the packets of a map; of older maps, and of ages without a scan, those of another map of the car."""
    return of_car.get(delay) or next((packets for packets in of_car.values() if packets), ())


def _build_scene(frames: FusionFrames, row: int, cars: Sequence[int]) -> RadioScene:
    """Return the cars of a frame as stations, and the frame's vehicles between them."""
    xy = frames.true_pose[row, list(cars), 0, :2].astype(np.float64)
    boxes = frames.boxes[row][frames.box_class[row] == 0].astype(np.float64)
    heights = assume_vehicle_heights(boxes[:, 3])
    gaps = portable.hypot(boxes[:, 0] - xy[:, None, 0], boxes[:, 1] - xy[:, None, 1])
    carriers = np.full(len(cars), -1, dtype=np.int64)
    if len(boxes):
        nearest = gaps.argmin(axis=1)
        carriers = np.where(gaps[np.arange(len(cars)), nearest] < SAME_CAR_M, nearest, -1)
    roofs: Float = np.where(carriers >= 0, np.append(heights, CAR_M)[carriers], CAR_M)
    blockers = np.column_stack((boxes, heights))
    no_walls = np.zeros((0, 4)), np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    classes, tops = classify_links(xy, carriers, len(cars), blockers, *no_walls)
    return RadioScene(tuple(map(str, cars)), xy, roofs, np.zeros(0), classes, tops)
