"""Exports of a converted log that was shifted are in the frame of the log."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mdrive_sumo.export.export_formats import EXPORT_FORMATS
from mdrive_sumo.export.export_run import export_recordings
from mdrive_sumo.export.log_frame import restore_log_frame
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.scoring.results import Infraction

ORIGIN = (690_000.0, 5_330_000.0)


@pytest.fixture(scope="module")
def shifted(recording: ScoredRecording) -> ScoredRecording:
    first, *others = recording.result.egos
    infraction = Infraction(kind="stop-sign", tick=7, x=3.0, y=4.0, factor=0.8, other="")
    egos = (first.model_copy(update={"infractions": (infraction,)}), *others)
    result = recording.result.model_copy(update={"egos": egos})
    return replace(recording, roads=replace(recording.roads, log_origin=ORIGIN), result=result)


@pytest.mark.slow
def test_everything_moves_by_the_origin_and_nothing_else_changes(
    recording: ScoredRecording, shifted: ScoredRecording
) -> None:
    there = restore_log_frame(shifted)
    valid = recording.record.valid
    for k, axis in enumerate(("x", "y")):
        moved = getattr(there.record, axis)[valid] - getattr(recording.record, axis)[valid]
        np.testing.assert_allclose(moved, ORIGIN[k], atol=1e-6)
        assert [getattr(ego.start, axis) for ego in there.scenario.egos] == pytest.approx(
            [getattr(ego.start, axis) + ORIGIN[k] for ego in recording.scenario.egos]
        )
    np.testing.assert_array_equal(there.record.yaw, recording.record.yaw)
    np.testing.assert_array_equal(there.record.speed, recording.record.speed)
    for id_, lane in there.roads.lanes.items():
        np.testing.assert_allclose(
            lane.centre.xy - recording.roads.lanes[id_].centre.xy, [ORIGIN] * len(lane.centre.xy)
        )
    for ego, was in zip(there.scenario.egos, recording.scenario.egos, strict=True):
        np.testing.assert_allclose(ego.xy - was.xy, [ORIGIN] * len(ego.xy))
    (infraction,) = there.result.egos[0].infractions
    assert (infraction.x, infraction.y) == (ORIGIN[0] + 3.0, ORIGIN[1] + 4.0)
    assert there.roads.log_origin == (0.0, 0.0)


@pytest.mark.slow
def test_a_recording_that_was_not_shifted_is_the_same_object(recording: ScoredRecording) -> None:
    assert restore_log_frame(recording) is recording


@pytest.mark.slow
@pytest.mark.parametrize(("name", "origin"), [("csv", ORIGIN), ("fcd", (0.0, 0.0))])
def test_tables_have_the_frame_of_the_log_and_sumos_files_that_of_their_network(
    name: str, origin: tuple[float, float], recording: ScoredRecording, shifted: ScoredRecording, tmp_path: Path
) -> None:
    assert EXPORT_FORMATS[name].is_in_log_frame == any(origin)
    plain, moved = (export_recordings([one], name, tmp_path / str(k)) for k, one in enumerate((recording, shifted)))
    if name == "fcd":
        files = sorted(path.name for path in plain.iterdir())
        assert all((plain / one).read_bytes() == (moved / one).read_bytes() for one in files if one.endswith(".xml"))
        return
    xy = [
        np.array([(float(row["x"]), float(row["y"])) for row in csv.DictReader(text.splitlines())])
        for text in ((folder / "states.csv").read_text() for folder in (plain, moved))
    ]
    np.testing.assert_allclose(xy[1] - xy[0], [origin] * len(xy[0]), atol=1e-6)
