"""Shards are tar files as Python's tarfile writes them, whatever pieces they are joined from."""

import io
import tarfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.learning.sample_files import SampleFiles, pack_samples, read_members, write_members, write_shard

SAMPLES = st.dictionaries(st.sampled_from(["labels.npz", "front.jpg", "about.json"]), st.binary(max_size=1100)).map(
    lambda files: SampleFiles("train-s0-r0-000001_c0_00004", files)
)


def write_by_tarfile(samples: list[SampleFiles]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as shard:
        for sample in samples:
            for suffix, data in sample.files.items():
                member = tarfile.TarInfo(f"{sample.key}.{suffix}")
                member.size = len(data)
                shard.addfile(member, io.BytesIO(data))
    return buffer.getvalue()


@given(st.lists(st.lists(SAMPLES, max_size=8), max_size=3))
def test_joined_members_are_the_archive_that_tarfile_writes(
    tmp_path_factory: pytest.TempPathFactory, scenarios: list[list[SampleFiles]]
) -> None:
    folder: Path = tmp_path_factory.mktemp("shard")
    parts = [folder / f"part-{number}" for number in range(len(scenarios))]
    for path, samples in zip(parts, scenarios, strict=True):
        size, _ = write_members(path, pack_samples(samples))
        assert size == path.stat().st_size
    write_shard(folder / "shard.tar", read_members(parts))
    assert (folder / "shard.tar").read_bytes() == write_by_tarfile([one for samples in scenarios for one in samples])
