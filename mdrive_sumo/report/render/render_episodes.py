"""Render recorded episodes as a picture or a video; several are shown side by side."""

from collections.abc import Sequence
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.report.render.canvas import GAP_PX, Pixels, join_pictures
from mdrive_sumo.report.render.frame_painter import FramePainter
from mdrive_sumo.report.render.frame_times import choose_telling_cav, choose_ticks, find_telling_tick
from mdrive_sumo.report.render.perspective_painters import ChaseViewPainter, DriverViewPainter
from mdrive_sumo.report.render.picture_files import PICTURE, check_output, write_gif, write_mp4, write_png
from mdrive_sumo.report.render.render_options import DEFAULT_FPS, DEFAULT_SIZE, RenderOptions
from mdrive_sumo.report.render.rendered_episode import RenderedEpisode
from mdrive_sumo.report.render.top_view_painter import TopViewPainter

LEAST_PX, MOST_PX = 160, 4096
"""[px] Sides of a picture: on less, captions cover the scene; the most is chosen: the width of 4K film."""
MAX_FPS = 50
"""The shortest time that programs show a frame of a GIF is 20 ms."""
MAX_GIF_PIXELS = 2_000_000_000
"""All frames of a GIF are in memory with a byte a pixel: 2 GB."""
MIN_SPEED, MAX_SPEED = 0.05, 20.0
"""Slower, a tick would be shown for more than a second; faster, an episode would be over in a second or two."""


def render_episodes(episodes: Sequence[RenderedEpisode], path: Path, options: RenderOptions) -> Path:
    """Write the picture (.png) or video (.gif, .mp4) of episodes of one scenario and return its path.

    Shorter episodes keep their last tick. Raises InputError.
    """
    check_output(path, options.force)
    ending = path.suffix.lower()
    whole = _find_size(options, ending, len(episodes))
    size = (whole[0] - GAP_PX * (len(episodes) - 1)) // len(episodes), whole[1]
    ticks = _find_ticks(episodes, ending, options)
    painters = [_make_painter(episode, size, options) for episode in episodes]

    def paint(tick: int) -> Pixels:
        parts = [painter.paint(min(tick, painter.episode.record.ticks - 1)) for painter in painters]
        return join_pictures(parts, whole[0])

    if ending == PICTURE:
        write_png(path, paint(ticks[0]))
    else:
        _check_length(ticks, whole, ending)
        writer = write_gif if ending == ".gif" else write_mp4
        writer(path, paint, ticks, _find_fps(options, ending))
    return path


def _make_painter(episode: RenderedEpisode, size: tuple[int, int], options: RenderOptions) -> FramePainter:
    names = episode.record.ego_ids
    follow = options.follow
    if follow is not None and follow not in names:
        raise InputError(f"render: follow: {describe_unknown(follow, names)}")
    if options.view != "top":
        chosen = follow or choose_telling_cav(episode.record, episode.result)
        painter = ChaseViewPainter if options.view == "chase" else DriverViewPainter
        return painter(episode, size, options.messages, names.index(chosen))
    return TopViewPainter(episode, size, options.messages, None if follow is None else names.index(follow))


def _find_size(options: RenderOptions, ending: str, panels: int) -> tuple[int, int]:
    """Return width and height of the picture. Raises InputError."""
    width, height = options.size or DEFAULT_SIZE[ending]
    panel = (width - GAP_PX * (panels - 1)) // panels
    for name, value in (("width", width), ("height", height)):
        if not LEAST_PX <= value <= MOST_PX:
            raise InputError(f"render: size: {name}: expected {LEAST_PX} to {MOST_PX} pixels, found {value}")
    if panel < LEAST_PX:
        raise InputError(f"render: size: width: expected {LEAST_PX} pixels for each of {panels} runs, found {width}")
    if ending == ".mp4" and (width % 2 or height % 2):
        raise InputError(f"render: size: expected even numbers for .mp4, found {width}x{height}")
    return width, height


def _check_length(ticks: Sequence[int], size: tuple[int, int], ending: str) -> None:
    """Raise InputError for a GIF that would fill the memory: all its frames are held there."""
    pixels = len(ticks) * size[0] * size[1]
    if ending == ".gif" and pixels > MAX_GIF_PIXELS:
        raise InputError(
            f"render: expected at most {MAX_GIF_PIXELS:.0e} pixels in all frames of a .gif, found {pixels:.1e}; a"
            " smaller --size, --fps or range, or an .mp4"
        )


def _find_fps(options: RenderOptions, ending: str) -> int:
    fps = DEFAULT_FPS[ending] if options.fps is None else options.fps
    if not 1 <= fps <= MAX_FPS:
        raise InputError(f"render: fps: expected 1 to {MAX_FPS}, found {fps}")
    return fps


def _find_ticks(episodes: Sequence[RenderedEpisode], ending: str, options: RenderOptions) -> list[int]:
    """Return the ticks that are drawn. Raises InputError for one outside the episode, or an option that has no use."""
    end = max(episode.record.ticks for episode in episodes) - 1
    if ending == PICTURE:
        _refuse({"from": options.first, "to": options.last, "fps": options.fps}, "a video (.gif, .mp4)")
        chosen = find_telling_tick((episode.record, episode.result) for episode in episodes)
        return [_check_tick("tick", chosen if options.tick is None else options.tick, 0, end)]
    _refuse({"tick": options.tick}, "a picture (.png)")
    if not MIN_SPEED <= options.speed <= MAX_SPEED:
        raise InputError(f"render: speed: expected {MIN_SPEED:g} to {MAX_SPEED:g}, found {options.speed:g}")
    first = _check_tick("from", 0 if options.first is None else options.first, 0, end)
    last = _check_tick("to", end if options.last is None else options.last, first, end)
    return choose_ticks(first, last, _find_fps(options, ending), options.speed)


def _check_tick(name: str, tick: int, least: int, most: int) -> int:
    if not least <= tick <= most:
        raise InputError(f"render: {name}: expected a tick of {least} to {most}, found {tick}")
    return tick


def _refuse(options: dict[str, int | None], where: str) -> None:
    for name, value in options.items():
        if value is not None:
            raise InputError(f"render: {name}: expected only with {where}, found {value}")
