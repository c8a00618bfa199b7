"""Write pictures as PNG, GIF or MP4 files: completely or not at all."""

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path

import numpy as np
from PIL import Image

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import draft_file, make_parents
from mdrive_sumo.report.render.canvas import Pixels
from mdrive_sumo.report.render.frame_times import choose_durations_cs

PICTURE, VIDEOS = ".png", (".gif", ".mp4")
ENDINGS = (PICTURE, *VIDEOS)
GIF_COLOURS = 255
"""Fewer than 256, so that one is left for pixels that do not change."""
UNUSED_COLOUR = (255, 0, 255)
"""Of the entry that stands for transparent pixels; no part of a picture is magenta."""
PALETTE_FRAMES = 6
"""From so many frames, evenly spaced, the colours of a GIF are chosen."""
GIF_HOLD_S = 1.0
"""How much longer the last frame of a GIF is shown before it begins again."""
FFMPEG = "ffmpeg"
MP4_QUALITY = "20"
"""Constant rate factor of H.264: 0 is lossless, 51 the worst; 18 to 28 is the usual range of its documentation."""

Paint = Callable[[int], Pixels]
"""Return the picture of a tick."""


def check_output(path: Path, force: bool) -> None:
    """Raise InputError for a file that cannot or may not be written."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(
            f"{path}: expected a name that ends in {', '.join(ENDINGS)}, found {path.suffix or 'no ending'}"
        )
    if path.is_dir() or (path.exists() and not force):
        remedy = "" if path.is_dir() else "; --force replaces it"
        raise InputError(f"{path}: expected a new file, found {'a folder' if path.is_dir() else 'one'} there{remedy}")
    if path.suffix.lower() == ".mp4" and shutil.which(FFMPEG) is None:
        raise InputError(
            f"{path}: expected the program ffmpeg for .mp4, found none; install it (apt-get install ffmpeg),"
            " or write a .gif"
        )


@contextmanager
def open_draft(path: Path) -> Generator[Path]:
    """Yield a file beside `path` that takes its place when the block succeeds. Raises InputError if it cannot."""
    try:
        make_parents(path)
        with draft_file(path) as draft:
            yield draft
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def write_png(path: Path, picture: Pixels) -> None:
    """Write one picture."""
    with open_draft(path) as draft:
        Image.fromarray(picture).save(draft)


def write_gif(path: Path, paint: Paint, ticks: list[int], fps: int) -> None:
    """Write a GIF that repeats for ever, with one palette for all frames: only what changes takes space."""
    sample = [ticks[i] for i in sorted({*np.linspace(0, len(ticks) - 1, PALETTE_FRAMES).astype(int).tolist()})]
    palette = _choose_palette([paint(tick)[::2, ::2] for tick in sample])
    frames = (Image.fromarray(paint(tick)).quantize(palette=palette, dither=Image.Dither.NONE) for tick in ticks)
    durations = [10 * duration for duration in choose_durations_cs(len(ticks), fps, GIF_HOLD_S)]
    colours = bytes(palette.getpalette() or ())
    with open_draft(path) as draft:
        next(frames).save(
            *(draft, "gif"),
            save_all=True,
            append_images=frames,
            duration=durations,
            loop=0,
            palette=colours,
            optimize=True,  # what is as in the frame before becomes transparent
            transparency=len(colours) // 3 - 1,
        )


def _choose_palette(pictures: list[Pixels]) -> Image.Image:
    """Return an image with the palette for pictures, whose last colour stands for transparent pixels."""
    whole = Image.fromarray(np.concatenate(pictures))
    parts = whole.quantize(GIF_COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).getpalette() or []
    colours = [*dict.fromkeys(zip(parts[::3], parts[1::3], parts[2::3], strict=True))][:GIF_COLOURS]
    palette = Image.new("P", (1, 1))
    palette.putpalette([part for colour in (*colours, UNUSED_COLOUR) for part in colour])
    return palette


def write_mp4(path: Path, paint: Paint, ticks: list[int], fps: int) -> None:
    """Write a video in H.264 with the program ffmpeg. Raises InputError with its last line if it fails."""
    frames = (paint(tick) for tick in ticks)
    first = next(frames)
    height, width = first.shape[:2]
    with open_draft(path) as draft:
        command = (
            *(FFMPEG, "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"),
            *("-r", str(fps), "-i", "-", "-an", "-c:v", "libx264", "-crf", MP4_QUALITY, "-pix_fmt", "yuv420p"),
            *("-movflags", "+faststart", str(draft)),
        )
        _feed(command, chain((first,), frames), path)


def _feed(command: Iterable[str], frames: Iterator[Pixels], path: Path) -> None:
    with tempfile.TemporaryFile() as errors:
        with subprocess.Popen(list(command), stdin=subprocess.PIPE, stderr=errors) as encoder:
            assert encoder.stdin is not None, "expected a pipe"
            try:
                for frame in frames:
                    encoder.stdin.write(frame.tobytes())
            except BrokenPipeError:
                pass  # it has ended: its last line says why
            finally:
                _close(encoder)
        errors.seek(0)
        lines = errors.read().decode(errors="replace").strip().splitlines()
        if encoder.returncode:
            raise InputError(f"{path}: ffmpeg failed with exit code {encoder.returncode}: {lines[-1] if lines else ''}")


def _close(encoder: "subprocess.Popen[bytes]") -> None:
    try:
        if encoder.stdin is not None:
            encoder.stdin.close()
    except BrokenPipeError:
        pass
