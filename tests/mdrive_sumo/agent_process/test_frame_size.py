"""Sensor data that are too large for the frame file, or for which there is no room: one sentence."""

import errno
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mdrive_sumo.agent_process import frame_file
from mdrive_sumo.agent_process.frame_file import FrameFolder
from mdrive_sumo.core.errors import InputError


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[FrameFolder]:
    opened = FrameFolder(tmp_path)
    yield opened
    opened.close()


def test_a_rig_that_is_too_large_is_one_sentence(folder: FrameFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_file, "MAX_FRAME_BYTES", 100_000)
    folder.begin()
    folder.store(np.zeros(90_000, np.uint8))
    with pytest.raises(InputError, match=r"expected arrays of at most 100000 bytes .*build_camera_rig") as caught:
        folder.store(np.zeros(90_000, np.uint8))
    assert "\n" not in str(caught.value)


def test_no_room_is_a_failure_of_ours_with_its_reason(
    folder: FrameFolder, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail(*_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", fail)
    folder.begin()
    with pytest.raises(OSError, match=f"expected room for 131072 bytes of sensor data in {tmp_path}; fewer workers"):
        folder.store(np.zeros(90_000, np.uint8))
