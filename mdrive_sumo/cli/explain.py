"""`mdrive-sumo explain`."""

from pathlib import Path

import click

from mdrive_sumo.cli.stored_run_options import load_one_recording, moved_suite_option
from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.core.terminal import echo


@click.command("explain")
@click.argument("run_folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--scenario", "pattern", metavar="GLOB", help="An id, or a glob that fits one [default: the first].")
@click.option("--cav", metavar="ID", help="The CAV, by its id in the scenario [default: all, one after the other].")
@click.option("--tick", type=int, help="Tell what holds in this tick, and since when [default: the whole story].")
@click.option("--seed", type=int, help="Which one in a run of several seeds [default: the first].")
@moved_suite_option
def command(
    run_folder: Path, pattern: str | None, cav: str | None, tick: int | None, seed: int | None, suite: str | None
) -> None:
    """Tell in sentences what a CAV did and why: where it departed, braked, waited, negotiated, collided or arrived.

    What it did is in the recording; why is what its agent noted, so far as it notes reasons: all built-in agents do.
    Road users that an agent knew by names of its own are named as the recording names them. A tick is 1/20 s.
    """
    from mdrive_sumo.core.geometry import Polyline
    from mdrive_sumo.report.story import CavStory

    recording = load_one_recording(run_folder, pattern, seed, suite)
    record, cavs = recording.record, recording.record.ego_ids
    if cav is not None and cav not in cavs:
        hint = suggest_name(cav, cavs)
        raise InputError(f"--cav: expected a CAV of {record.scenario} ({', '.join(cavs)}), found {cav!r:.40}{hint}")
    if tick is not None and not 0 <= tick < record.ticks:
        raise InputError(f"--tick: expected 0 to {record.ticks - 1}, the ticks of {record.scenario}, found {tick}")
    routes = {ego.id: ego.xy for ego in recording.scenario.egos}
    for one in cavs if cav is None else (cav,):
        story = CavStory(record, one, recording.result, Polyline(routes[one]).length)
        for line in story.tell() if tick is None else story.tell_moment(tick):
            echo(clean_line(line))
