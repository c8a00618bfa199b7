"""MDrive scenario directories to be, in CARLA's frame, on the made-up town."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mdrive_sumo.scenario.scripted_actor import Actor
from real2sim.readers.mdrive import read_mdrive
from real2sim.source_scene import SourceScene
from testing.made_up_town import make_town

Waypoint = tuple[float, ...]
"""x, y, yaw in CARLA's frame, and a time if there is a fourth."""


def xml(points: Sequence[Waypoint], inside: str = "", **attributes: object) -> str:
    """A route file of town TownXX, route 5, unless said otherwise."""
    said = {"id": "5", "town": "TownXX", **attributes}
    text = " ".join(f'{name}="{value}"' for name, value in said.items())
    tags = "".join(
        f'<waypoint x="{p[0]}" y="{p[1]}" z="0" yaw="{p[2]}"' + (f' time="{p[3]}"' if len(p) > 3 else "") + "/>"
        for p in points
    )
    return f"<routes><route {text}>{inside}{tags}</route></routes>"


TIMED = [(60, 1.75, 0, 0.5), (62, 1.75, 0, 0.6), (64, 1.75, -10, 0.7)]
EGO = xml([(20, 1.75, 0), (90, 1.75, 0)])
NEXT = xml([(40, 1.75, 0), (90, 1.75, 0)])
WALK = xml([(60, 8, -90), (60, -6, -90)])


class Directory:
    """A scenario directory to be: two CAVs, and the actors that are added."""

    def __init__(self, root: Path) -> None:
        self.towns = make_town(root / "towns")
        self.folder = root / "Category" / "7"
        self.folder.mkdir(parents=True)
        self.manifest: dict[str, Any] = {"ego": [], "npc": []}
        self.behaviors: list[Any] = []
        self.add("ego", "x_vehicle_1_0.xml", EGO, name="Vehicle 1")
        self.add("ego", "x_vehicle_2_1.xml", NEXT, name="Vehicle 2")

    def add(self, key: str, file: str, text: str, **entry: object) -> None:
        self.manifest.setdefault(key, []).append({"file": file, "kind": key, "route_id": "5", **entry})
        (self.folder / file).parent.mkdir(parents=True, exist_ok=True)
        (self.folder / file).write_text(text)

    def behave(self, actor: str, action: object, **trigger: object) -> None:
        said = {"type": "distance_to_vehicle", "vehicle": "Vehicle 1", **trigger}
        self.behaviors.append({"route_id": "5", "actor_name": actor, "trigger": said, "action": action})

    def write(self) -> Path:
        (self.folder / "actors_manifest.json").write_text(json.dumps(self.manifest))
        if self.behaviors:
            (self.folder / "actors_behavior.json").write_text(json.dumps({"behaviors": self.behaviors}))
        return self.folder

    def read(self) -> SourceScene:
        return read_mdrive(self.write(), self.towns)

    def actor(self) -> Actor:
        (actor,) = self.read().actors
        return actor
