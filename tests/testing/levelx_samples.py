"""Small recordings in the layouts of inD, rounD, exiD and highD for tests."""

from collections.abc import Sequence
from pathlib import Path

from testing.interaction_samples import build_street

GROUND_HEADER = (
    "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,xAcceleration,"
    "yAcceleration,lonVelocity,latVelocity,lonAcceleration,latAcceleration"
)
IMAGE_HEADER = "frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,laneId"
UTM_ORIGIN = (166021.443, 0.0)
"""[m] Easting and northing of (0, 0) degrees in UTM zone 31, where the small streets lie."""


def write_lines(path: Path, *lines: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def format_ground_row(
    track: int, frame: int, x: float, y: float = 2.0, heading: float = 0.0, size: tuple[float, float] = (4.5, 1.8)
) -> str:
    return f"0,{track},{frame},0,{x},{y},{heading},{size[1]},{size[0]},10,0,0,0,10,0,0,0"


def write_ground(folder: Path, rows: Sequence[str], classes: dict[int, str], frames: int = 101) -> Path:
    """Write a recording in the layout of inD with its map where the data set has it; return the tracks."""
    build_street_map(folder / "maps" / "lanelets" / "a" / "location4.osm")
    data = folder / "data"
    write_lines(
        data / "07_recordingMeta.csv",
        "recordingId,locationId,frameRate,speedLimit,xUtmOrigin,yUtmOrigin,orthoPxToMeter",
        f"7,4,25.0,13.9,{UTM_ORIGIN[0]},{UTM_ORIGIN[1]},0.01",
    )
    write_lines(
        data / "07_tracksMeta.csv",
        "recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class",
        *(f"7,{track},0,{frames - 1},{frames},1.8,4.5,{kind}" for track, kind in classes.items()),
    )
    return write_lines(data / "07_tracks.csv", GROUND_HEADER, *rows)


def build_street_map(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return build_street().write(path)


def write_image(folder: Path, rows: Sequence[str], tracks: dict[int, tuple[str, int]], frames: int = 101) -> Path:
    """Write a recording in the layout of highD; `tracks` has class and driving direction by id."""
    write_lines(
        folder / "01_recordingMeta.csv",
        "id,frameRate,locationId,speedLimit,upperLaneMarkings,lowerLaneMarkings",
        "1,25,2,-1.00,8.5;12.5;16.5,21.0;25.0;29.0",
    )
    write_lines(
        folder / "01_tracksMeta.csv",
        "id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection",
        *(f"{track},4.5,1.8,1,{frames},{frames},{kind},{way}" for track, (kind, way) in tracks.items()),
    )
    return write_lines(folder / "01_tracks.csv", IMAGE_HEADER, *rows)
