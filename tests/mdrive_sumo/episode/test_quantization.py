"""Recording resolution: the same bits from the Python text and from the compiled layer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from testing.twins import compare_twins

from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import Actors, Contact, EgoState, Frame, Kind
from mdrive_sumo.episode.quantization import pack_states, quantize_frame

ANY = st.floats(allow_nan=True, allow_infinity=True)
LIMIT = 2**31 * 1e-4 - 1
"""What a recording can hold of every field."""
HELD = st.one_of(st.floats(-LIMIT, LIMIT), st.integers(-9999, 9999).map(lambda n: (n + 0.5) * 1e-4))


def frames(numbers: st.SearchStrategy[float]) -> st.SearchStrategy[Frame]:
    egos = st.dictionaries(st.text(max_size=3), st.builds(EgoState, *[numbers] * 7), max_size=3)
    columns = st.integers(0, 4).flatmap(
        lambda n: st.lists(st.lists(numbers, min_size=n, max_size=n), min_size=6, max_size=6)
    )
    return st.builds(
        Frame, st.integers(0, 9999), egos, columns.map(to_actors), st.just({"t": "gr"}),
        st.sampled_from(((), (Contact("0", "a", Kind.VEHICLE),))),
    )  # fmt: skip


def to_actors(columns: list[list[float]]) -> Actors:
    table = np.array(columns, dtype=np.float64).reshape(6, -1)
    ids = tuple(str(i) for i in range(table.shape[1]))
    return Actors(ids, np.zeros(len(ids), dtype=np.uint8), *table)


@given(frame=st.one_of(frames(ANY), frames(HELD)))
def test_both_texts_round_a_frame_alike(frame: Frame) -> None:
    compare_twins("episode_quantization_quantize_frame", frame)


@given(frame=frames(ANY))
def test_both_texts_pack_odd_frames_alike(frame: Frame) -> None:
    compare_twins("episode_quantization_pack_states", frame)


@pytest.mark.slow
@given(frame=frames(HELD))
def test_both_texts_pack_a_frame_alike(frame: Frame) -> None:
    compare_twins("episode_quantization_pack_states", frame)
    assert pack_states(quantize_frame(frame)) == pack_states(frame)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e9])
def test_a_state_that_no_recording_holds_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="expected a state that a recording can hold"):
        pack_states(Frame(0, {"0": EgoState(value, 0.0, 0.0, 0.0)}, Actors.empty(), {}))


@given(
    st.dictionaries(
        st.sampled_from("abc"), st.builds(Control, st.floats(0, 1), st.floats(0, 1), st.one_of(st.floats(-1, 1), ANY))
    )
)
def test_both_texts_pack_controls_alike(controls: dict[str, Control]) -> None:
    compare_twins("episode_quantization_pack_controls", ("c", "a"), controls)


@given(arrays(np.float64, array_shapes(max_dims=2, min_side=0), elements=st.one_of(HELD, ANY)))
def test_both_texts_round_points_alike(points: np.ndarray) -> None:
    compare_twins("episode_quantization_round_points", points)
