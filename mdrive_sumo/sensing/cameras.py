"""Error message for camera sensors, which do not exist here."""

import re

CAMERA_WORDS = frozenset({"camera", "rgb", "rgba", "depth", "semantic", "segmentation", "fisheye", "image"})


def describe_camera_error(kind: str) -> str:
    """Return the error for a camera kind ("rgb", "sensor.camera.depth", "CAM_FRONT"...); "" for other kinds."""
    words = re.split(r"[^a-z]+", kind.lower())
    if not CAMERA_WORDS.isdisjoint(words) or words[0] == "cam":
        return (
            f"sensor {kind!r}: expected a sensor that needs no rendered images, found a camera: "
            'there is no renderer here; use "objects", "lidar" or "bev" instead'
        )
    return ""
