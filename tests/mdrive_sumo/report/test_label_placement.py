"""Labels of pictures: none covers another one, none is far without need."""

from itertools import combinations

from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.report.label_placement import LabelBox, LabelRequest, place_labels

COORDINATE, SIZE = st.floats(-40.0, 40.0), st.floats(0.5, 12.0)
REQUEST = st.builds(LabelRequest, COORDINATE, COORDINATE, SIZE, st.floats(0.5, 3.0), st.floats(0.0, 3.0))
BOX = st.builds(LabelBox, COORDINATE, COORDINATE, SIZE, SIZE)


@given(st.lists(REQUEST, max_size=25), st.lists(BOX, max_size=5))
def test_labels_overlap_neither_each_other_nor_what_was_there(
    requests: list[LabelRequest], taken: list[LabelBox]
) -> None:
    placed = place_labels(requests, taken)
    assert [(box.width, box.height) for box in placed] == [(one.width, one.height) for one in requests]
    assert not any(one.overlaps(other) for one, other in combinations(placed, 2))
    assert not any(one.overlaps(other) for one in placed for other in taken)


def test_forty_labels_of_one_place_all_find_room() -> None:
    placed = place_labels([LabelRequest(0.0, 0.0, 8.0, 2.0, 1.0)] * 40)
    assert not any(one.overlaps(other) for one, other in combinations(placed, 2))
    assert max(abs(box.y) for box in placed) < 40


def test_a_label_alone_is_above_its_thing() -> None:
    (box,) = place_labels([LabelRequest(3.0, 4.0, 8.0, 2.0, 1.0)])
    assert (box.x, box.y) == (3.0, 6.0)


def test_boxes_that_only_touch_do_not_overlap() -> None:
    assert not LabelBox(0, 0, 2, 2).overlaps(LabelBox(2, 0, 2, 2))
    assert LabelBox(0, 0, 2, 2).overlaps(LabelBox(1.9, 0, 2, 2))
