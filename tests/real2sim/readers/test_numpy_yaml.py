"""NumPy's numbers in YAML: read as PyYAML writes them, refused if their bytes do not fit."""

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from real2sim.readers.numpy_yaml import MAX_DIMENSIONS, NUMBERS, NumpyLoader


def load(text: str) -> object:
    return yaml.load(text, NumpyLoader)


@settings(max_examples=30)
@given(
    arrays(
        st.sampled_from([np.dtype(order + kind) for kind in sorted(NUMBERS) for order in "<>"]),
        array_shapes(max_dims=MAX_DIMENSIONS, min_side=0, max_side=4),
    ).filter(lambda array: bool(np.isfinite(array).all()))
)
def test_arrays_and_numbers_are_read_as_they_were(array: np.ndarray) -> None:
    content = {"array": array, "turned": array.T, "again": array, "numbers": list(array.ravel()), "tuple": (1, 2)}
    expected = {"numbers": array.ravel().tolist(), "tuple": [1, 2]}
    lists = {"array": array.tolist(), "turned": array.T.tolist(), "again": array.tolist()}
    assert load(yaml.dump(content)) == lists | expected


SQUARE = yaml.dump(np.eye(2))
NUMBER = yaml.dump(np.float64(2.0))


@pytest.mark.parametrize(
    "text",
    [
        SQUARE.replace("- 2", "- 3", 1),
        SQUARE.replace("- 2", "- -2"),
        SQUARE.replace("- 2", "- 1e9", 1),
        SQUARE.replace("- f8", "- O8"),
        SQUARE.replace("- f8", "- V8"),
        SQUARE.replace("- <", "- '|'"),
        SQUARE.replace("state:", "other:"),
        SQUARE.replace("AAAAAAAA8D8", "AAAA", 1),
        SQUARE.replace("- false\n- !!binary", "- no array\n- !!binary"),
        NUMBER.replace("AAAAAAAAAEA=", "AAA="),
        NUMBER.replace("f8", "f4"),
        "!!python/object/apply:numpy.dtype [f8]",
        "!!python/object/apply:numpy.dtype f8",
        "!!python/object/apply:numpy.core.multiarray.scalar 3",
        "!!python/object/apply:numpy.core.multiarray.scalar [1, 2, 3]",
        "!!python/object/apply:numpy.core.multiarray._reconstruct [1]",
        "&a !!python/tuple [*a]",
        "!!python/tuple 3",
        "!!python/name:os.system ''",
        "!!python/object/apply:os.getcwd []",
    ],
)
def test_other_content_is_an_error_of_the_file(text: str) -> None:
    assert text not in (SQUARE, NUMBER)
    with pytest.raises(yaml.YAMLError):
        load(text)
