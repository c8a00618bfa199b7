"""Camera images beside a recording: what is kept, how much, and files from strangers."""

import errno
import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mdrive_sumo.contract import CameraImage, Observation, OwnState
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import camera_archive
from mdrive_sumo.episode.camera_archive import INDEX, CameraArchiveWriter, load_camera_tracks


def observe(tick: int, shade: int, camera: str = "front", kind: str = "rgb", width: int = 64) -> dict[str, Observation]:
    pixels = np.full((32, width, 3) if kind == "rgb" else (32, width), shade, dtype=np.uint8)
    own = OwnState(*[0.0] * 7)
    return {"0": Observation(tick, own, cameras={camera: CameraImage(kind, pixels, 50.0)})}


def test_images_come_back_by_cav_camera_and_tick_and_the_same_images_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.zip", "b.zip"):
        with CameraArchiveWriter(tmp_path / "new" / name) as archive:
            for tick in (0, 4, 8):
                archive.add(tick, observe(tick, 20 * tick))
            archive.add(9, observe(9, 7, camera="../rear</script>", width=1200))
            archive.add(9, observe(9, 7, kind="semantic"))
    first, rear = load_camera_tracks(tmp_path / "new" / "a.zip")
    assert (first.ego, first.camera, sorted(first.images)) == ("0", "front", [0, 4, 8])
    shades = [np.asarray(Image.open(io.BytesIO(first.images[tick]))).mean() for tick in (0, 4, 8)]
    assert shades == pytest.approx([0, 80, 160], abs=2)
    assert rear.camera == "../rear</script>"
    assert Image.open(io.BytesIO(rear.images[9])).width == 400
    files = [tmp_path / "new" / name for name in ("a.zip", "b.zip")]
    assert files[0].read_bytes() == files[1].read_bytes()


def test_without_images_or_after_an_error_there_is_no_file(tmp_path: Path) -> None:
    path = tmp_path / "x.zip"
    path.write_bytes(b"of an earlier run")
    with CameraArchiveWriter(path) as archive:
        archive.add(0, observe(0, 1, kind="semantic"))
    assert not list(tmp_path.iterdir())
    with pytest.raises(RuntimeError, match="stop"), CameraArchiveWriter(path) as archive:
        archive.add(0, observe(0, 1))
        raise RuntimeError("stop")
    assert not list(tmp_path.iterdir())


def test_where_the_disk_is_full_no_part_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = CameraArchiveWriter._write

    def fail_at_the_end(self: CameraArchiveWriter, name: str, data: bytes) -> None:
        if name == INDEX:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(self, name, data)

    monkeypatch.setattr(CameraArchiveWriter, "_write", fail_at_the_end)
    with pytest.raises(OSError, match="No space"), CameraArchiveWriter(tmp_path / "x.zip") as archive:
        archive.add(0, observe(0, 1))
    assert not list(tmp_path.iterdir())


def test_without_images_there_is_no_folder(tmp_path: Path) -> None:
    with CameraArchiveWriter(tmp_path / "cameras" / "x.zip") as archive:
        archive.add(0, observe(0, 1, kind="depth"))
    assert not list(tmp_path.iterdir())


def test_an_archive_has_a_largest_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_archive, "MAX_ARCHIVE_BYTES", 2000)
    with CameraArchiveWriter(tmp_path / "x.zip") as archive:
        for tick in range(20):
            archive.add(tick, observe(tick, tick))
    (track,) = load_camera_tracks(tmp_path / "x.zip")
    assert 1 <= len(track.images) < 5
    with zipfile.ZipFile(tmp_path / "x.zip") as found:
        assert f'"left_out": {20 - len(track.images)}' in found.read(INDEX).decode()


@pytest.mark.parametrize(
    "members",
    [
        {},
        {INDEX: b"[]"},
        {INDEX: b"{"},
        {INDEX: b'{"cameras": [{"ego": "0"}]}'},
        {INDEX: b'{"cameras": [{"ego": "0", "camera": "x"}]}', "1/000000.jpg": b""},
        {INDEX: b'{"cameras": [{"ego": "0", "camera": "x"}]}', "0/-1.jpg": b""},
        {INDEX: b'{"cameras": [{"ego": "0", "camera": "x"}]}', "0/../../x": b""},
        {INDEX: b'{"cameras": []}', "0/000000.jpg": b"0" * (camera_archive.MAX_IMAGE_BYTES + 1)},
    ],
)
def test_strange_archives_are_one_sentence(tmp_path: Path, members: dict[str, bytes]) -> None:
    path = tmp_path / "x.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    with pytest.raises(InputError, match="expected camera images of `eval --record-cameras`") as caught:
        load_camera_tracks(path)
    assert "\n" not in str(caught.value)


def test_what_is_no_archive_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "x.zip").write_bytes(b"PK\x03\x04 nothing")
    with pytest.raises(InputError, match="found a corrupt file"):
        load_camera_tracks(tmp_path / "x.zip")


def test_an_image_that_ends_behind_the_file_is_a_corrupt_file(tmp_path: Path) -> None:
    """Found by the fuzz job: it was a traceback (EOFError)."""
    path = tmp_path / "images.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(INDEX, b"{}")
    data = bytearray(path.read_bytes())
    entry = data.index(b"PK\x01\x02")
    data[entry + 20 : entry + 28] = struct.pack("<II", 5000, 5000)  # sizes in the list of members
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"images\.zip: expected camera images .*, found a corrupt file"):
        load_camera_tracks(path)
