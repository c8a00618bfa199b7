"""Fixtures of several tests of readers."""

from pathlib import Path

import pytest
from testing.commonroad_samples import Write, format_scenario
from testing.interaction_samples import (
    PEDESTRIANS,
    build_street,
    write_table,
)
from testing.mdrive_directory import Directory


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_scenario(*parts: str, **options: str) -> Path:
        path = tmp_path / "scenario.xml"
        path.write_text(format_scenario(*parts, **options))
        return path

    return write_scenario


@pytest.fixture(scope="module")
def data(shared_data: Path) -> Path:
    return shared_data / "real_logs" / "interaction"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    build_street().write(tmp_path / "map.osm")
    write_table(
        tmp_path / "vehicle_tracks_007.csv",
        "1,5,500,car,1,2,10,0,0.1,4.5,1.8",
        "1,6,600,car,2,2,10,0,0.1,4.5,1.8",
        "1,8,800,car,4,2,10,0,0.1,4.5,1.8",
        "2,6,600,truck,9,2,10,0,3.1,9,2.5",
    )
    write_table(
        tmp_path / "pedestrian_tracks_007.csv",
        "P1,4,400,pedestrian/bicycle,0,9,1,1",
        "P2,4,400,pedestrian/bicycle,0,9,4,3",
        header=PEDESTRIANS,
    )
    return tmp_path


@pytest.fixture
def directory(tmp_path: Path) -> Directory:
    return Directory(tmp_path)
