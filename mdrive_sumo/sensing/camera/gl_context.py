"""Create an OpenGL context without a display, and keep a bounded number of its objects."""

import os
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, Generic, TypeVar

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation

DEVICE_VARIABLE = "GLCONTEXT_DEVICE_INDEX"
"""Environment variable with the number of the EGL device that renders, from 0; read by the package glcontext."""
LEAST_VERSION = 430
"""OpenGL 4.3 draws many parts of a scene by one call."""
Key = TypeVar("Key", bound=Hashable)


def create_context() -> Any:
    """Return a moderngl context. Raises InputError without moderngl, a driver, or the device that is asked for."""
    try:
        import moderngl
    except ImportError:
        raise InputError(
            f"camera: expected the package moderngl, which renders images, found none; {format_installation('camera')}"
        ) from None
    device = os.environ.get(DEVICE_VARIABLE, "0")
    if not device.isdecimal():
        raise InputError(f"camera: {DEVICE_VARIABLE}: expected the number of an EGL device, found {device[:40]!r}")
    os.environ.setdefault("LP_NUM_THREADS", "0")  # Mesa's software renderer: a worker process has one core
    try:
        create: Any = moderngl.create_context  # its stub takes no name of a backend
        context = create(standalone=True, require=LEAST_VERSION, backend="egl")
    except Exception as error:  # noqa: BLE001 - moderngl raises bare Exception without a driver
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            "camera: expected an OpenGL 4.3 driver that renders without a display (EGL; on Debian the packages libegl1 "
            f"and libgl1-mesa-dri) as EGL device {device} ({DEVICE_VARIABLE}), found none: {reason}"
        ) from None
    context.gc_mode = "auto"  # what is dropped from a cache is freed
    return context


class RecentObjects(Generic[Key]):
    """The objects that were used last, by key; others are dropped."""

    def __init__(self, size: int, build: Callable[[Key], Any]) -> None:
        self._size, self._build = size, build
        self._found: OrderedDict[Key, Any] = OrderedDict()

    def __len__(self) -> int:
        return len(self._found)

    def get(self, key: Key) -> Any:
        """Return the object of a key, built if it is not among the last ones."""
        if key not in self._found:
            self._found[key] = self._build(key)
            if len(self._found) > self._size:
                self._found.popitem(last=False)
        self._found.move_to_end(key)
        return self._found[key]
