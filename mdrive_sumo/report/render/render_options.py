"""RenderOptions: what a picture or a video shows, and how."""

from dataclasses import dataclass
from typing import Literal

ViewName = Literal["top", "chase", "driver"]
DEFAULT_SIZE = {".png": (1280, 720), ".gif": (800, 450), ".mp4": (1280, 720)}
"""Width and height [px] by ending."""
DEFAULT_FPS = {".gif": 10, ".mp4": 20}


@dataclass(frozen=True, slots=True)
class RenderOptions:
    """What is drawn, and how. None: chosen by the file's ending and by what happened."""

    view: ViewName = "top"
    follow: str | None = None
    """Id of a CAV. None: the whole scene; in the chase and driver views the CAV of the first infraction."""
    tick: int | None = None
    """Tick that a picture shows."""
    first: int | None = None
    """First and last tick of a video, both included."""
    last: int | None = None
    size: tuple[int, int] | None = None
    """Width and height of the picture or video [px]."""
    fps: int | None = None
    """Frames of a video in a second."""
    speed: float = 1.0
    messages: bool = True
    """Whether CPMs and MCMs are drawn as lines."""
    force: bool = False
    """Whether an existing file is replaced."""
