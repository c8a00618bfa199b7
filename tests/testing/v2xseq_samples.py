"""Small scenes in the layout of V2X-Seq's trajectories for tests."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HEADER = "city,timestamp,id,type,sub_type,tag,x,y,z,length,width,height,theta,v_x,v_y,intersect_id"


def format_row(
    id_: str, frame: int, x: float, y: float, kind: str = "VEHICLE,CAR", tag: str = "OTHERS", theta: float = 0.0
) -> str:
    return f"PEK,{1626.2 + frame / 10:.3f},{id_},{kind},{tag},{x:.2f},{y},0,4.6,1.9,1.5,{theta},8,0,crossing#1"


def format_points(*points: tuple[float, float]) -> list[str]:
    return [f"({x}, {y})" for x, y in points]


def describe_map() -> dict[str, Any]:
    """Two lanes east, one behind the other, with a bicycle lane beside them, and one lane west."""

    def lane(*points: tuple[float, float], **more: Any) -> dict[str, Any]:
        usual = {"lane_type": "CITY_DRIVING", "turn_direction": "NONE", "is_intersection": "False"}
        ids = {"l_neighbor_id": "None", "r_neighbor_id": "None", "predecessors": [], "successors": []}
        return {"has_traffic_control": "False", **usual, **ids, "centerline": format_points(*points), **more}

    return {
        "LANE": {
            "11": lane((0, 0), (30, 0), (60, 0), successors=["12"], r_neighbor_id="13"),
            "12": lane((60, 0), (120, 0), predecessors=["11"], is_intersection="True"),
            "13": lane((0, -3.5), (60, -3.5), lane_type="BIKING", l_neighbor_id="11"),
            "14": lane((120, 3.5), (0, 3.5)),
        },
        "STOPLINE": {"21": {"centerline": format_points((59, -2), (59, 2))}},
        "CROSSWALK": {"31": {"polygon": format_points((50, -5), (53, -5), (53, 5), (50, 5))}},
    }


def list_rows(frames: int = 31) -> list[str]:
    rows = [format_row("7", frame, 10 + 0.8 * frame, 0.0, tag="AV") for frame in range(frames)]
    rows += [format_row("8", frame, 100 - 0.8 * frame, 3.5, theta=3.1415) for frame in range(frames)]
    return rows + [format_row("9", frame, 51.5, 5 - 0.1 * frame, "PEDESTRIAN,PEDESTRIAN") for frame in range(frames)]


def write_scene(folder: Path, rows: Sequence[str] | None = None, name: str = "10039.csv") -> tuple[Path, Path]:
    """Write a scene and its map; return both."""
    (folder / "maps").mkdir(parents=True, exist_ok=True)
    (folder / "scenes").mkdir(exist_ok=True)
    (folder / "maps" / "hdmap1.json").write_text(json.dumps(describe_map()))
    (folder / "scenes" / name).write_text("\n".join((HEADER, *(list_rows() if rows is None else rows))) + "\n")
    return folder / "scenes" / name, folder / "maps" / "hdmap1.json"
