"""What of senders' maps arrives over radios, and figures and tables of detectors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ResampledMean
from mdrive_sumo.learning.fusion.conditions import CONDITIONS
from mdrive_sumo.learning.fusion.detector_figures import (
    DetectorFigures,
    FigureKey,
    check_comparable,
    describe_frames,
    read_figures,
    write_figures,
)
from mdrive_sumo.learning.fusion.detector_tables import (
    summarise_detectors,
    write_detectors_json,
    write_detectors_page,
)
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.learning.fusion.sharing_channels import (
    CHANNELS,
    ArrivedMap,
    SharingChannel,
    find_arrived,
    list_map_delays,
)
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames
from mdrive_sumo.v2x.radio.radio_settings import RadioProfile

IDEAL, ITS_G5, LTE_V2X = CHANNELS


@pytest.fixture(scope="module")
def frames() -> FusionFrames:
    return build_synthetic_frames(1, 0, cavs=4)


def make_sizes(packets: Sequence[int], cars: int = 4) -> Mapping[int, Mapping[int, Sequence[int]]]:
    """Maps of every age have the same packets."""
    return {car: dict.fromkeys((0, 2), packets) for car in range(cars)}


def test_without_a_radio_all_packets_arrive_at_once(frames: FusionFrames) -> None:
    assert list_map_delays(IDEAL) == (0,) and list_map_delays(ITS_G5) == (0, 2)
    found = find_arrived(frames, 0, IDEAL, make_sizes((1398, 1398, 700)))
    assert found == {car: ArrivedMap(0, (0, 1, 2)) for car in (1, 2, 3)}


@pytest.mark.parametrize("channel", [ITS_G5, LTE_V2X])
def test_radios_deliver_what_fits_of_most_senders_in_time(channel: SharingChannel, frames: FusionFrames) -> None:
    sizes = make_sizes((1398,) * (channel.packets or 0))
    found = find_arrived(frames, 0, channel, sizes)
    assert found == find_arrived(frames, 0, channel, sizes)
    assert {*found} <= {1, 2, 3} and sum(one.delay == 0 for one in found.values()) >= 2


@pytest.mark.parametrize("channel", [ITS_G5, LTE_V2X])
def test_maps_beyond_the_air_time_of_a_station_come_late_or_never(
    channel: SharingChannel, frames: FusionFrames
) -> None:
    """Eleven full packets every 200 ms are 77 kB a second, where congestion control grants some 18."""
    found = find_arrived(frames, 0, channel, make_sizes((1398,) * 11))
    assert all(one.delay > 0 or len(one.packets) < 4 for one in found.values())


def test_a_car_without_a_map_sends_none_and_scans_of_other_ages_do_not_count(frames: FusionFrames) -> None:
    sizes = {0: {0: (700,)}, 1: {0: (), 2: ()}, 2: {2: (700,)}, 3: {0: (700,)}}
    found = find_arrived(frames, 0, SharingChannel("strong", RadioProfile.ITS_G5), sizes)
    assert 1 not in found and found[2].delay == 2 and found[3].delay == 0


def make_figures(detector: str, frames: FusionFrames, shift: float) -> DetectorFigures:
    random = np.random.default_rng(0)
    figures = DetectorFigures(detector, {"data": describe_frames(frames)})
    for condition in CONDITIONS:
        for min_iou in (0.5, 0.7):
            value = 0.5 + shift - (0.2 if shift and condition.name == "0.6 m" else 0.0)
            mean = ResampledMean(value, value + random.normal(0.0, 0.02, 2000), 20, 18.0)
            figures.precisions[FigureKey(condition.name, min_iou, "all")] = mean
    figures.use["ideal"] = {"map_bytes": 1234.0, "heard": 0.9, "age_ms": 10.0, "packets_arrived": 0.8}
    return figures


def test_figures_keep_their_resamples_and_tables_say_where_a_fusion_loses(frames: FusionFrames, tmp_path: Path) -> None:
    made = [make_figures("none", frames, 0.0), make_figures("attfuse", frames, 0.1)]
    figures = {each.detector: read_figures(write_figures(tmp_path, each)) for each in made}
    check_comparable(figures)
    for each in made:
        for key, value in each.precisions.items():
            kept = figures[each.detector].precisions[key]
            assert (kept.mean, kept.units) == (value.mean, value.units)
            assert np.array_equal(kept.resampled, value.resampled)
    summary = summarise_detectors(figures)
    page = write_detectors_page(summary)
    assert "| attfuse | 60.0 [" in page and "| attfuse | +10.0 [+10.0, +10.0]" in page
    assert "Of 8 pairs of a fusion and a condition 7 are above no fusion" in page
    assert "Below it are attfuse (0.6 m, -10.0)." in page and "| attfuse | ideal | 1234 | 90.0 | 10 | 80.0 |" in page
    assert '"detector": "attfuse"' in write_detectors_json(summary)


def test_figures_of_other_frames_or_files_are_refused(frames: FusionFrames, tmp_path: Path) -> None:
    fewer = replace(frames, box_class=np.full_like(frames.box_class, -1))
    pair = {"none": make_figures("none", frames, 0.0), "early": make_figures("early", fewer, 0.1)}
    with pytest.raises(InputError, match=r"figures of early: vehicles: expected \d+, as those of none were"):
        check_comparable(pair)
    path = tmp_path / "none.figures.npz"
    path.write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(InputError, match="expected figures of `learn evaluate-detectors`, found"):
        read_figures(path)
