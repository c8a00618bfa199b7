"""BevLifting: features of images to the bird's-eye grid, by the fixed calibration of a rig.

Each cell pulls the features at the places where its centre, at a few heights, is projected ("simple pull" of Harley et
al., Simple-BEV, 2023): indices are constants, so the exported network is a gather.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import ImageInput, SystemSpec
from mdrive_sumo.learning.networks.bev_grid import BEV_CELLS, BEV_CHANNELS, compute_cell_centres
from mdrive_sumo.learning.networks.blocks import ConvBlock
from mdrive_sumo.learning.networks.image_encoder import count_cells
from mdrive_sumo.sensing.camera.camera_model import CameraModel
from mdrive_sumo.sensing.camera.camera_sensor import read_camera_model

HEIGHTS_M = (0.0, 0.9, 2.0)
"""Above the ground: road surface, bodies of cars and people, their tops."""
STRIDE = 8
NEAREST_M = 0.5
"""[m] Least depth of a projected point."""
MOST_VIEWS = 2
"""Cameras that see one point: neighbours of a rig overlap in pairs; further ones are left out."""


@dataclass(frozen=True, slots=True)
class LiftingTable:
    """Where each cell looks: indices (heights, cells, views) into the maps of all cameras in a row, -1: nowhere."""

    indices: npt.NDArray[np.int64]
    feature_cells: int
    """Cells of all maps of stride 8 together."""


def load_camera_models(spec: SystemSpec) -> dict[str, CameraModel]:
    """Return the cameras of a system by their ids, with the images' sizes."""
    return {sensor.id: read_camera_model(sensor) for sensor in spec.build_sensors() if sensor.kind == "camera"}


def build_lifting_table(spec: SystemSpec) -> LiftingTable:
    """Project the grid's cells at HEIGHTS_M into all cameras of a system, in the order of its images."""
    models = load_camera_models(spec)
    centres = compute_cell_centres().reshape(-1, 2)
    heights = np.broadcast_to(np.array(HEIGHTS_M)[:, None, None], (len(HEIGHTS_M), len(centres), 1))
    points = np.concatenate((np.broadcast_to(centres, (len(HEIGHTS_M), *centres.shape)), heights), axis=-1)
    views: list[npt.NDArray[np.int64]] = []
    start = 0
    for image in spec.images:
        for camera in image.cameras:
            views.append(_index_features(models[camera], image, points, start))
            start += count_cells(image.height, STRIDE) * count_cells(image.width, STRIDE)
    pixels = np.stack(views, axis=-1)
    # Cameras that see the point first, each group in the order of the rig.
    order = np.argsort(pixels < 0, axis=-1, kind="stable")[..., :MOST_VIEWS]
    return LiftingTable(np.take_along_axis(pixels, order, axis=-1), start)


def _index_features(
    model: CameraModel, image: ImageInput, points: npt.NDArray[np.float64], start: int
) -> npt.NDArray[np.int64]:
    """Return the index of the feature nearest to each point, -1 where the image does not show it."""
    column, row, depth = np.moveaxis(model.project(model.find_view(0.0, 0.0, 0.0), points), -1, 0)
    is_inside = (depth > NEAREST_M) & (column >= 0) & (column < image.width) & (row >= 0) & (row < image.height)
    rows, columns = count_cells(image.height, STRIDE), count_cells(image.width, STRIDE)
    # A convolution of stride 2 and padding 1 is centred on every second pixel, from the first on.
    r = np.clip(np.rint((np.where(is_inside, row, 0.0) - 0.5) / STRIDE), 0, rows - 1).astype(np.int64)
    c = np.clip(np.rint((np.where(is_inside, column, 0.0) - 0.5) / STRIDE), 0, columns - 1).astype(np.int64)
    return np.where(is_inside, start + r * columns + c, -1)


class BevLifting(nn.Module):
    """Mean of the features that show a cell, for each height; a 1 x 1 convolution mixes the heights."""

    indices: Tensor
    weights: Tensor

    def __init__(self, spec: SystemSpec, channels: int) -> None:
        super().__init__()
        table = build_lifting_table(spec)
        is_seen = table.indices >= 0
        weights = is_seen / np.maximum(is_seen.sum(axis=-1, keepdims=True), 1)
        self.register_buffer(
            "indices", torch.from_numpy(np.maximum(table.indices, 0)).flatten().int(), persistent=False
        )
        self.register_buffer("weights", torch.from_numpy(weights.astype(np.float32))[..., None], persistent=False)
        self.mix = ConvBlock(len(HEIGHTS_M) * channels, BEV_CHANNELS, size=1)

    def forward(self, maps: list[Tensor]) -> Tensor:
        """Lift maps of stride 8, one (batch, cameras, channels, h, w) for each image input.

        Returns (batch, BEV_CHANNELS, BEV_CELLS, BEV_CELLS).
        """
        features = torch.cat([each.permute(0, 1, 3, 4, 2).flatten(1, 3) for each in maps], dim=1)
        pulled = features.index_select(1, self.indices)
        lifted = (pulled.unflatten(1, self.weights.shape[:3]) * self.weights.to(pulled.dtype)).sum(dim=3)
        stacked = lifted.permute(0, 1, 3, 2).flatten(1, 2).unflatten(2, (BEV_CELLS, BEV_CELLS))
        return self.mix(stacked)
