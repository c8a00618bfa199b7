"""`mdrive-sumo render`."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click

from mdrive_sumo.cli.stored_run_options import load_one_recording, moved_suite_option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.render.render_options import DEFAULT_FPS, DEFAULT_SIZE, RenderOptions, ViewName

if TYPE_CHECKING:
    from mdrive_sumo.export.scored_recording import ScoredRecording


def _parse_size(_: click.Context, __: click.Parameter, value: str | None) -> tuple[int, int] | None:
    if value is None:
        return None
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", value)
    if not found:
        raise click.BadParameter(f"expected WIDTHxHEIGHT in pixels, such as 1280x720, found {value!r}")
    return int(found[1]), int(found[2])


def _describe(values: dict[str, Any]) -> str:
    return ", ".join(f"{ending} {value}" for ending, value in values.items())


@click.command("render")
@click.argument("run_folders", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--scenario", "pattern", metavar="GLOB", help="An id, or a glob that fits one [default: the first].")
@click.option("--seed", type=int, help="Which one in a run of several seeds [default: the first].")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="FILE", help="Name.png, .gif or .mp4.")
@click.option("--view", type=click.Choice(get_args(ViewName)), default="top", show_default=True, help="From where.")
@click.option("--follow", metavar="CAV", help="Keep this CAV in sight [default: top: nothing; others: see above].")
@click.option("--tick", type=int, help="Of a picture [default: the first infraction or contact, else the middle].")
@click.option("--from", "first", type=int, metavar="TICK", help="First tick of a video [default: 0].")
@click.option("--to", "last", type=int, metavar="TICK", help="Last tick of a video [default: the last].")
@click.option(
    "--size",
    callback=_parse_size,
    metavar="WxH",
    help=f"Pixels [default: {_describe({end: f'{w}x{h}' for end, (w, h) in DEFAULT_SIZE.items()})}].",
)
@click.option("--fps", type=int, help=f"Frames a second [default: {_describe(DEFAULT_FPS)}].")
@click.option("--speed", type=float, default=1.0, show_default=True, help="2: twice as fast as it happened.")
@click.option("--messages/--no-messages", default=True, show_default=True, help="Lines for CPMs and MCMs that arrive.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
@moved_suite_option
def command(
    run_folders: tuple[Path, ...], pattern: str | None, seed: int | None, suite: str | None, out: Path, **options: Any
) -> None:
    """Draw a recorded episode: a picture of one tick (.png), or a video (.gif; .mp4 with the program ffmpeg).

    Several RUNs of one scenario are drawn side by side. --view top shows the whole scene from above, or 70 m around a
    followed CAV; --view chase shows it in perspective from behind the followed CAV, by default that of the first
    infraction; --view driver shows what its driver sees (both: extra camera). A tick is 1/20 s.
    """
    from mdrive_sumo.report.render.render_episodes import RenderedEpisode, check_output, render_episodes

    check_output(out, options["force"])
    found: list[ScoredRecording] = []
    for folder in run_folders:
        found.append(load_one_recording(folder, pattern or (found[0].scenario.id if found else None), seed, suite))
    if len(names := {one.scenario.id for one in found}) > 1:
        raise InputError(f"--scenario: expected one that fits the same scenario in all runs, found {sorted(names)}")
    episodes = [RenderedEpisode(one.record, one.scenario, one.roads, one.result) for one in found]
    echo(render_episodes(episodes, out, RenderOptions(**options)))
