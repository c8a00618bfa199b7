"""Error message for sensor kinds that name a camera in another way than the sensor `camera`."""

import re

CAMERA_WORDS = frozenset({"camera", "rgb", "rgba", "depth", "semantic", "segmentation", "fisheye", "image"})


def describe_camera_error(kind: str) -> str:
    """Return the error for other names of a camera ("rgb", "sensor.camera.depth", "CAM_FRONT"); "" for other kinds."""
    words = re.split(r"[^a-z]+", kind.lower())
    if not CAMERA_WORDS.isdisjoint(words) or words[0] == "cam":
        return (
            f'sensor {kind!r}: expected the sensor "camera" with an option kind ("rgb", "semantic", "depth" or '
            '"instance"), found another name of a camera'
        )
    return ""
