"""Lifting agrees with the camera model's projection."""

import numpy as np
import pytest
import torch

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.learning.networks.bev_grid import BEV_CELLS, compute_cell_centres
from mdrive_sumo.learning.networks.bev_lifting import (
    HEIGHTS_M,
    STRIDE,
    BevLifting,
    build_lifting_table,
    load_camera_models,
)
from mdrive_sumo.learning.networks.image_encoder import ImageEncoder, count_cells


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_cell_looks_where_its_centre_is_projected(system: str) -> None:
    spec = SYSTEMS[system]
    table, models, centres = build_lifting_table(spec), load_camera_models(spec), compute_cell_centres().reshape(-1, 2)
    starts, sizes = {}, {}
    start = 0
    for image in spec.images:
        for camera in image.cameras:
            starts[camera], sizes[camera] = start, image
            start += count_cells(image.height, STRIDE) * count_cells(image.width, STRIDE)
    assert table.feature_cells == start
    checked = 0
    for height, cell, view in zip(*np.nonzero(table.indices >= 0), strict=True):
        index = int(table.indices[height, cell, view])
        camera = [name for name in starts if starts[name] <= index][-1]
        columns = count_cells(sizes[camera].width, STRIDE)
        row, column = divmod(index - starts[camera], columns)
        model = models[camera]
        point = np.array((*centres[cell], HEIGHTS_M[height]))
        x, y, depth = model.project(model.find_view(0.0, 0.0, 0.0), point)
        assert depth > 0 and abs(x - 0.5 - STRIDE * column) <= STRIDE and abs(y - 0.5 - STRIDE * row) <= STRIDE
        checked += 1
    assert checked > 500


@pytest.mark.parametrize("system", ["vad", "lmdrive"])
def test_most_cells_ahead_are_seen(system: str) -> None:
    seen = (build_lifting_table(SYSTEMS[system]).indices >= 0).any(axis=(0, 2)).reshape(BEV_CELLS, BEV_CELLS)
    assert seen[:20].mean() > 0.95


def test_the_mean_of_the_features_that_show_a_cell() -> None:
    """Maps that hold one number per camera: a cell that two cameras show gets their mean."""
    spec = SYSTEMS["vad"]
    lifting = BevLifting(spec, 2)
    table = build_lifting_table(spec)
    cameras = len(spec.images[0].cameras)
    maps = torch.arange(cameras, dtype=torch.float32)[None, :, None, None, None].expand(1, -1, 2, 14, 25)
    lifting.mix = torch.nn.Identity()  # pyright: ignore[reportAttributeAccessIssue]
    lifted = lifting([maps])[0].reshape(len(HEIGHTS_M), 2, -1).numpy()
    camera_of = table.indices // (14 * 25)
    for height in range(len(HEIGHTS_M)):
        for cell in range(0, BEV_CELLS * BEV_CELLS, 37):
            seen = [int(c) for c, i in zip(camera_of[height, cell], table.indices[height, cell], strict=True) if i >= 0]
            assert lifted[height, 0, cell] == pytest.approx(np.mean(seen) if seen else 0.0)


def test_a_feature_of_stride_8_is_centred_on_every_eighth_pixel() -> None:
    """The pixels that a feature depends on lie around the place where the table expects it."""
    encoder = ImageEncoder((4, 4, 4, 4), 4).eval()
    for each in encoder.parameters():
        each.data.fill_(0.05)
    encoder.top_down.weight.data.fill_(0.0)
    images = torch.full((1, 1, 112, 200, 3), 200.0, requires_grad=True)
    fine, _ = encoder(images)
    fine[0, 0, :, 5, 11].abs().sum().backward()
    assert images.grad is not None
    weight = images.grad[0, 0].abs().sum(dim=-1)
    rows, columns = torch.meshgrid(torch.arange(112.0), torch.arange(200.0), indexing="ij")
    centre = (weight * rows).sum() / weight.sum(), (weight * columns).sum() / weight.sum()
    assert float(centre[0]) == pytest.approx(5 * STRIDE, abs=0.6)
    assert float(centre[1]) == pytest.approx(11 * STRIDE, abs=0.6)
