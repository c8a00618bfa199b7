"""Random pauses, rewinds, hand-overs and kills: every take equals its parent bit for bit and verifies, none is lost."""

from pathlib import Path

import pytest
from testing.drives import make_setup
from testing.random_drives import RandomDrive, check_takes


@pytest.mark.full
@pytest.mark.parametrize(("count", "seed"), [(40, 2), (1000, 2)])
def test_every_take_of_a_random_drive_verifies(suite: Path, tmp_path: Path, count: int, seed: int) -> None:
    drive = RandomDrive(make_setup(tmp_path / "drive", suite, speed_up=1000.0, people=("0", "1")), count, seed)
    drive.run()
    assert drive.lost == []
    assert drive.done["rewind"] > count / 5
    assert drive.done["kill"] > 0
    tree = check_takes(tmp_path / "drive")
    assert len(drive.driven) > count / 8
    assert drive.driven <= set(tree.takes)
