"""The OpenGL context: sentences about what is missing, and a bounded number of objects."""

import builtins
from typing import Any

import numpy as np
import pytest
from testing.camera_scenes import build_scene, needs_opengl, place_car, take_image

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.sensing.camera import gl_context
from mdrive_sumo.sensing.camera.camera_renderer import MOST_SCENES, load_renderer
from mdrive_sumo.sensing.camera.gl_context import DEVICE_VARIABLE, RecentObjects, create_context
from mdrive_sumo.sensing.camera.static_scene import load_static_scene


def test_a_missing_package_is_one_sentence_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name == "moderngl":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install '\.\[camera\]'"):
        create_context()


@needs_opengl
def test_a_driver_that_is_too_old_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl_context, "LEAST_VERSION", 990)
    with pytest.raises(InputError, match=r"expected an OpenGL .* driver .* found none") as caught:
        create_context()
    assert "\n" not in str(caught.value)


@needs_opengl
@pytest.mark.parametrize(
    ("device", "said"), [("99", "as EGL device 99"), ("gpu", "expected the number of an EGL device")]
)
def test_an_unknown_device_is_one_sentence(monkeypatch: pytest.MonkeyPatch, device: str, said: str) -> None:
    monkeypatch.setenv(DEVICE_VARIABLE, device)
    with pytest.raises(InputError, match=said):
        create_context()


def test_the_objects_that_were_used_last_are_kept() -> None:
    built: list[str] = []

    def build(key: str) -> str:
        built.append(key)
        return key.upper()

    objects = RecentObjects[str](2, build)
    assert [objects.get(key) for key in "abab"] == ["A", "B", "A", "B"]
    objects.get("a")
    objects.get("c")
    assert len(objects) == 2
    objects.get("a")
    assert built == ["a", "b", "c"]
    objects.get("b")
    assert built == ["a", "b", "c", "b"]


@needs_opengl
@pytest.mark.slow
def test_objects_of_few_networks_are_kept_and_images_stay_the_same() -> None:
    first = load_road_map(find_network_folder("minor_road"))
    place = (*first.driving[0].centre.at(1.0), first.driving[0].centre.yaw_at(1.0))
    before = take_image(build_scene([place_car(*place)]), first, width=64, height=64).pixels
    for name in ("avenue", "crescent", "freeway"):
        roads = load_road_map(find_network_folder(name))
        take_image(build_scene([place_car(0.0, 0.0, 0.0)]), roads, width=64, height=64)
    assert len(load_renderer()._scenes) == MOST_SCENES == load_static_scene.cache_info().maxsize
    after = take_image(build_scene([place_car(*place)]), first, width=64, height=64).pixels
    assert (np.asarray(before) == after).all()
