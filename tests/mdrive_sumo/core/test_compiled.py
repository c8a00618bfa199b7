"""The compiled layer: the same bits as the Python text, and what happens without it."""

import ctypes
import gc
import math
import os
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from testing.paths import ROOT
from testing.twins import REFUSALS, check_memory, compare_twins

from mdrive_sumo.core import compiled, portable
from mdrive_sumo.core.compiled.sources import list_sources
from mdrive_sumo.core.version import __version__

ANY = st.floats(allow_nan=True, allow_infinity=True)
ORDINARY = st.one_of(st.floats(-700.0, 700.0), st.floats(-1e-3, 1e-3), st.sampled_from((0.0, -0.0, 1.0, -1.0)))


def test_the_layer_is_there_and_built_from_all_files() -> None:
    assert compiled.USED_LAYER is not None, compiled.PROBLEM
    assert compiled.USED_LAYER.FILES.split() == list_sources(ROOT)


def test_every_compiled_function_has_its_python_text_beside_it() -> None:
    for file in map(Path, list_sources(ROOT)):
        if file.suffix == ".c" and file.parent.name != "compiled":
            import_module(".".join(file.with_suffix("").parts))
    functions = {name for name in dir(compiled.USED_LAYER) if callable(getattr(compiled.USED_LAYER, name))}
    assert functions - {"__loader__"} == set(compiled.REFERENCES)


@pytest.mark.parametrize("name", ["cos_sin", "cos", "sin", "sinc", "atan"])
@given(x=st.one_of(ORDINARY, ANY))
def test_functions_of_a_number(name: str, x: float) -> None:
    compare_twins(f"core_portable_{name}", x)


@pytest.mark.parametrize("name", ["exp", "expm1"])
@given(x=st.one_of(ORDINARY, st.floats(-1e9, 1e9), ANY))
def test_exponentials(name: str, x: float) -> None:
    compare_twins(f"core_portable_{name}", x)


@given(x=st.one_of(st.floats(min_value=0.0), ORDINARY, ANY))
def test_logarithms(x: float) -> None:
    compare_twins("core_portable_log", x)


@given(x=st.lists(st.one_of(st.floats(min_value=0.0), ORDINARY, ANY), max_size=5))
def test_exponentials_and_logarithms_of_arrays(x: list[float]) -> None:
    for name in ("exp", "log"):
        for part in (x, [abs(value) for value in x], [value for value in x if 0.0 < value < math.inf]):
            compare_twins(f"core_portable_{name}", np.array(part))


@pytest.mark.parametrize("name", ["atan2", "hypot"])
@example(y=0.0, x=math.nan)
@given(y=st.one_of(ORDINARY, ANY), x=st.one_of(ORDINARY, ANY))
def test_functions_of_two_numbers(name: str, y: float, x: float) -> None:
    compare_twins(f"core_portable_{name}", y, x)


@pytest.mark.parametrize("shape", [(), (0,), (1,), (7,), (3, 0, 2), (3, 4)])
def test_functions_of_arrays(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0.1, 9.0, (2, *shape))
    for name in ("cos_sin", "cos", "sin", "tan", "sinc", "exp", "log"):
        compare_twins(f"core_portable_{name}", x)
    for name in ("atan2", "hypot"):
        for pair in ((y, x), (y, 2.0), (y[..., None], np.array((1.0, -2.0))), (y.astype(np.float32), x.T.copy().T)):
            compare_twins(f"core_portable_{name}", *pair)


def test_a_tangent_of_a_quarter_turn_is_refused_in_arrays_too() -> None:
    with pytest.raises(ArithmeticError):
        portable.tan(math.pi / 2)
    assert compare_twins("core_portable_tan", np.array((0.0, math.pi / 2))) == REFUSALS


@pytest.mark.parametrize("dtype", [">f8", "<f8", "f4", ">f4", "f2", ">i8", "i4", "u1", "?"])
def test_arrays_of_other_types_and_byte_orders_are_converted(dtype: str) -> None:
    values = np.array((0.0, 1.0, 0.0, 1.0, 1.0)).astype(dtype)
    in_the_middle = np.frombuffer(b"." + values.tobytes(), dtype=dtype, offset=1)
    for array in (values, values[::2], values[::-1], in_the_middle):
        compare_twins("core_portable_cos", array)
        assert compare_twins("contract_reply_check_are_within", array, 0.5) == (not array.any())


KEPT: list[object] = []


@pytest.mark.parametrize(
    "leak",
    [
        lambda value: KEPT.append(object()),
        lambda value: KEPT.append(ctypes.CDLL(None).malloc(1)),
        lambda value: ctypes.pythonapi.Py_IncRef(ctypes.py_object(value)),
        lambda value: KEPT.append(np.empty(10**3)),
    ],
)
def test_memory_that_a_call_keeps_is_found(leak: Callable[[object], None]) -> None:
    gc.collect()  # else what tests before this one left is freed during the calls and hides what they keep
    with pytest.raises(AssertionError, match="add"):
        check_memory(leak, object())
    check_memory(portable.cos_sin, 1.0)


def run(code: str, **environment: str) -> str:
    done = subprocess.run(
        (sys.executable, "-c", code), capture_output=True, text=True, check=True, env={**os.environ, **environment}
    )
    return done.stdout.strip()


@pytest.mark.slow
def test_the_switch_uses_the_python_text_without_a_word() -> None:
    code = "from mdrive_sumo.core import compiled, portable; print(type(portable.cos_sin), compiled.format_notice())"
    assert run(code, MDRIVE_COMPILED="off") == "<class 'function'>"
    assert run(code) == "<class 'builtin_function_or_method'>"


@pytest.mark.parametrize(
    ("layer", "reason"),
    [
        ("raise ImportError('layer.abi3.so: wrong ELF class')", "layer.abi3.so: wrong ELF class"),
        ("VERSION = '0.0.9'", f"expected version {__version__}, found 0.0.9 in"),
        (f"VERSION, FILES, SOURCES = {__version__!r}, 'mdrive_sumo/core/portable.c', '1'", "found an older one"),
        (f"VERSION, FILES, SOURCES = {__version__!r}, 'mdrive_sumo/core/removed.c', '1'", "found an older one"),
    ],
)
def test_a_layer_that_cannot_be_used_is_named(tmp_path: Path, layer: str, reason: str) -> None:
    (tmp_path / "broken.py").write_text(layer)
    code = f"""
import sys; sys.path.insert(0, {str(tmp_path)!r})
from mdrive_sumo.core import version
import importlib.util, mdrive_sumo.core
source = open(mdrive_sumo.core.__path__[0] + "/compiled/twins.py").read()
__file__ = mdrive_sumo.core.__path__[0] + "/compiled/twins.py"
exec(compile(source.replace('"mdrive_sumo.core.compiled.layer"', '"broken"'), "compiled", "exec"))
print(format_notice())
"""
    assert reason in run(code)
