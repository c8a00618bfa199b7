"""Which part of a log becomes a scenario, and under which name."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.small_log import recording

from mdrive_sumo.core.errors import InputError
from real2sim.pipeline import log_conversion
from real2sim.pipeline.conversion_options import ConversionOptions
from real2sim.pipeline.log_conversion import convert_log, make_scenario_id, split_into_windows
from real2sim.pipeline.log_source import LogSource
from real2sim.recording import Recording


def without_tracks(frames: int, dt_s: float = 0.1) -> Recording:
    return replace(recording(), frame_count=frames, dt_s=dt_s, views=())


def source(window: tuple[float, float] | None = None) -> LogSource:
    return LogSource("test", Path("/logs/small.x"), window=window)


@given(st.integers(2, 1200), st.floats(2.0, 40.0), st.sampled_from([0.05, 0.1, 0.5]))
def test_windows_follow_each_other_through_the_log(frames: int, every_s: float, dt_s: float) -> None:
    """All are `every_s` long but the last, which is at least half of that; less is left out."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(log_conversion, "read_log_limited", lambda _: without_tracks(frames, dt_s))
        windows = split_into_windows(source(), every_s)
    end_s = (frames - 1) * dt_s
    starts, ends = np.array(windows).T
    lengths = ends - starts
    assert starts[0] == 0.0
    assert starts[1:] == pytest.approx(ends[:-1], abs=2e-3)
    assert lengths[:-1] == pytest.approx(every_s, abs=2e-3)
    assert lengths[-1] <= every_s + 2e-3
    assert len(windows) == 1 or lengths[-1] >= max(every_s / 2, 2.0) - dt_s / 2 - 2e-3
    left_out_s = end_s - ends[-1]
    assert -1e-3 <= left_out_s < max(every_s / 2, 2.0) + 1e-3


def test_windows_of_a_window_lie_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_conversion, "read_log_limited", lambda _: recording())
    assert split_into_windows(source((1.0, 3.6)), 1.3) == ((1.0, 2.3),)
    with pytest.raises(InputError, match=r"/logs/small\.x: expected .* \(window 7 s to 9 s\)"):
        split_into_windows(source((7.0, 9.0)), 2.0)


LENGTHS = {
    "one_frame": (without_tracks(1), "expected at least 2 s, found 0 s: too short"),
    "short": (without_tracks(20), r"expected at least 2 s, found 1\.9 s: too short"),
    "few_frames": (without_tracks(4, 1.0), "expected at least 6 s, found 3 s: too short"),
    "long": (without_tracks(602), r"at most 60 s, found a log of 60\.1 s: choose a part with --window 0,20, or cut it"),
}


@pytest.mark.parametrize("name", LENGTHS)
def test_a_log_of_another_length_is_refused_in_one_sentence(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, sentence = LENGTHS[name]
    monkeypatch.setattr(log_conversion, "read_log_limited", lambda _: found)
    with pytest.raises(InputError, match=rf"^/logs/small\.x: .*{sentence}"):
        convert_log(source(), tmp_path, ConversionOptions())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("frames", [21, 601])
def test_the_shortest_and_the_longest_log_pass_the_check(
    frames: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_conversion, "read_log_limited", lambda _: without_tracks(frames))
    with pytest.raises(InputError, match="expected tracks of at least half a second, found none"):
        convert_log(source(), tmp_path, ConversionOptions())


@given(st.text(max_size=120), st.none() | st.tuples(st.floats(0, 1e4), st.floats(0, 1e4)))
def test_ids_are_identifiers_and_keep_their_window(name: str, window: tuple[float, float] | None) -> None:
    id_ = make_scenario_id(name, window)
    assert re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,79}", id_)
    assert window is None or id_.endswith(f"_{window[0]:g}-{window[1]:g}s")


def test_an_id_is_the_name_of_its_log_where_that_is_one() -> None:
    assert make_scenario_id("sd_scene-0757.v1", None) == "sd_scene-0757.v1"
    assert make_scenario_id("2023 04/ü", (0.5, 20.0)) == "2023_04___0.5-20s"
    assert make_scenario_id("..._x", None) == "x"
    assert make_scenario_id("___", None) == "log"
