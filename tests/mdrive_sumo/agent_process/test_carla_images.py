"""Images in CARLA's encodings, decoded by CARLA's published formulas."""

from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import pytest

from mdrive_sumo.agent_process.carla_images import convert_image, make_camera_specs
from mdrive_sumo.contract import CameraImage, Observation, OwnState

OWN = OwnState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def seen(**images: CameraImage) -> Observation:
    return Observation(0, OWN, cameras=MappingProxyType(images))


def convert(**images: CameraImage) -> npt.NDArray[np.uint8]:
    image = convert_image("front", seen(**images))
    assert image is not None and image.dtype == np.uint8 and image.shape == (2, 3, 4)
    assert (image[..., 3] == 255).all()
    return image


def test_colours_are_blue_green_red() -> None:
    pixels = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    assert (convert(front=CameraImage("rgb", pixels, 100.0))[..., :3] == pixels[..., ::-1]).all()


def test_depth_is_decoded_to_less_than_a_tenth_of_a_millimetre() -> None:
    depth = np.array([[0.1, 1.0, 12.345], [99.99, 500.0, 1000.0]], dtype=np.float32)
    blue, green, red = np.moveaxis(convert(front=CameraImage("depth", depth, 100.0))[..., :3].astype(float), -1, 0)
    decoded = 1000 * (red + 256 * green + 65536 * blue) / (256**3 - 1)
    assert np.abs(decoded - depth).max() < 1e-4


def test_classes_are_red() -> None:
    classes = np.array([[7, 7, 13], [10, 4, 1]], dtype=np.uint8)
    assert (convert(front=CameraImage("semantic", classes, 100.0))[..., 2] == classes).all()


def test_an_instance_keeps_its_number_and_has_its_class() -> None:
    classes = np.array([[7, 10, 10], [7, 4, 4]], dtype=np.uint8)
    index = np.array([[-1, 0, 0], [-1, 1, 1]], dtype=np.int32)
    beside = CameraImage("semantic", classes, 100.0)
    images = [
        convert(**{"front": CameraImage("instance", found, 100.0, names), "front/classes": beside})
        for found, names in ((index, ("t01", "tff")), (np.where(index >= 0, 1 - index, -1), ("tff", "t01")))
    ]
    assert (images[0] == images[1]).all()
    assert (images[0][..., 2] == classes).all()
    numbers = images[0][..., 1] + 256 * images[0][..., 0].astype(int)
    assert (numbers[:, 0] == 0).all() and len(np.unique(numbers)) == 3


def test_between_two_images_there_is_none() -> None:
    assert convert_image("front", seen()) is None


@pytest.mark.parametrize(("kind", "count"), [("rgb", 1), ("depth", 1), ("semantic", 1), ("instance", 2)])
def test_sizes_are_carlas_where_none_is_declared(kind: str, count: int) -> None:
    specs = make_camera_specs({}, "front", kind, {"x": 1.0})
    assert len(specs) == count
    assert all(
        (spec.options["width"], spec.options["height"], spec.options["fov_deg"]) == (800, 600, 90.0) for spec in specs
    )
