"""What is said about a log and its parts, and logs that no reader may return."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.small_log import recording, track

from mdrive_sumo.core.errors import InputError
from real2sim.pipeline.log_source import READERS, LogSource, describe_part, prefix_with_log, read_log
from real2sim.recording import ObserverView, RecordedTrack, Recording

PATH = Path("/logs/small.x")


@pytest.mark.parametrize(
    ("log", "part"),
    [
        (LogSource("test", PATH), ""),
        (LogSource("test", PATH, case="7"), "case 7"),
        (LogSource("test", PATH, window=(0.5, 20.0)), "window 0.5 s to 20 s"),
        (LogSource("test", PATH, case="7", window=(0.0, 2.0)), "case 7, window 0 s to 2 s"),
    ],
)
def test_a_sentence_names_its_log_once_and_the_part(log: LogSource, part: str) -> None:
    after = f" ({part})" if part else ""
    assert describe_part(log) == part
    assert prefix_with_log(log, "expected tracks") == f"/logs/small.x: expected tracks{after}"
    assert prefix_with_log(log, "/logs/small.x: line 3: expected tracks") == (
        f"/logs/small.x: line 3: expected tracks{after}"
    )


def read(found: Recording, monkeypatch: pytest.MonkeyPatch) -> Recording:
    monkeypatch.setitem(READERS, "test", lambda _: found)
    return read_log(LogSource("test", PATH))


def with_value(name: str, value: float) -> Recording:
    one = track("1", 20.0, 0.0, 8.0)
    column = getattr(one, name).copy()
    column[3:5] = np.nan, value
    changed: RecordedTrack = one.replace_columns(**{name: column})
    return replace(recording(), views=(ObserverView("log", (track("2", 0.0, 0.0, 1.0), changed)),))


@pytest.mark.parametrize(("name", "most"), [("x", 1e8), ("y", 1e8), ("length", 200.0), ("width", 200.0)])
def test_values_of_no_place_on_earth_are_refused_by_track_and_column(
    name: str, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their sums would be infinite. NaN is a frame without a value."""
    fits = with_value(name, most)
    assert read(fits, monkeypatch) is fits
    for value in (most * 1.01, -most * 1.01, 1e300):
        with pytest.raises(InputError, match=rf"^/logs/small\.x: track 1: {name}: expected at most .* m, found more"):
            read(with_value(name, value), monkeypatch)


def test_a_package_that_is_not_installed_is_named_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    def need(_: LogSource) -> Recording:
        raise ModuleNotFoundError("No module named 'pyproj.crs'", name="pyproj.crs")

    monkeypatch.setitem(READERS, "test", need)
    with pytest.raises(InputError, match=r"^test: expected the package pyproj, found none \(.*convert.*\)$"):
        read_log(LogSource("test", PATH))
