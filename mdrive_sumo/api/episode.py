"""Episode: a recorded episode with the scenario and the road network that it belongs to."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mdrive_sumo.api.scenario_source import find_scenario
from mdrive_sumo.core.data_frame import build_data_frame
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.episode import EpisodeRecord, save_episode
from mdrive_sumo.episode import load_episode as load_record
from mdrive_sumo.report.render.render_options import ViewName
from mdrive_sumo.report.replay_page import ReplayPage
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.reference_times import NO_REFERENCE, find_reference_times
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scoring import ScenarioResult, ScoreMode, score_episode

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Episode:
    """One run of one scenario: what happened, and what it scores."""

    record: EpisodeRecord
    """Everything that was recorded, as arrays of ticks by road users."""
    scenario: Scenario
    """As the seed drew it; `scenario.as_written` is that of the suite."""
    roads: RoadMap
    seed: int = 0
    suite_folder: Path | None = None
    """Folder of the scenario's suite, which has the reference times; None: of no suite."""

    def __len__(self) -> int:
        """Number of recorded ticks (20 per second)."""
        return self.record.ticks

    def __repr__(self) -> str:
        endings = ", ".join(f"{ending.ego} {ending.end}" for ending in self.record.endings)
        return f"Episode({self.scenario.id!r}, seed {self.seed}, {len(self)} ticks, {endings})"

    @property
    def digest(self) -> str:
        """Digest over every tick: two episodes with the same digest are identical."""
        return self.record.digest

    @cached_property
    def result(self) -> ScenarioResult:
        """Scores, infractions and outcomes in score mode `mdrive`; `score` computes other modes."""
        return self.score(ScoreMode.MDRIVE)

    def score(self, mode: ScoreMode | str) -> ScenarioResult:
        """Return the scores in a score mode, without simulating."""
        folder = self.suite_folder
        reference = find_reference_times(self.scenario, folder) if folder is not None else NO_REFERENCE
        return score_episode(self.record, self.scenario, self.roads, ScoreMode(mode), self.seed, reference)

    def to_frame(self) -> "pd.DataFrame":
        """Return one row per tick and road user that is present: poses in the world frame [m, rad, m/s].

        The columns throttle, brake and steer are the controls applied after the tick; NaN for road users that are not
        CAVs. Needs pandas (extra `notebook`).
        """
        record = self.record
        ticks, columns = np.nonzero(record.valid)
        kinds = np.array([kind.name.lower() for kind in Kind])
        is_cav = columns < record.egos
        controls = np.full((len(ticks), 3), np.nan)
        controls[is_cav] = record.control_values[ticks[is_cav], columns[is_cav]]
        return build_data_frame(
            {
                "tick": ticks,
                "time_s": ticks * DT,
                "id": np.array(record.ids, dtype=object)[columns],
                "kind": kinds[record.kind[columns]],
                "is_cav": is_cav,
                **{name: getattr(record, name)[ticks, columns] for name in ("x", "y", "yaw", "speed")},
                "length": record.length[columns],
                "width": record.width[columns],
                **dict(zip(("throttle", "brake", "steer"), controls.T, strict=True)),
            }
        )

    def messages_to_frame(self) -> "pd.DataFrame":
        """Return one row per V2X message and receiver: what was sent when, and what became of it.

        `delivery` is a delivery status such as "delivered" or "lost", and `delivery_tick` its tick. Needs pandas.
        """
        columns = ("tick", "sender", "type", "bytes", "receiver", "delivery", "delivery_tick")
        return build_data_frame(self._list_deliveries(), columns)

    def _list_deliveries(self) -> Iterator[dict[str, Any]]:
        for sent in self.record.messages:
            message = sent.message
            for receiver, (status, tick) in sent.deliveries.items():
                yield {
                    "tick": message.tick,
                    "sender": message.sender,
                    "type": message.type,
                    "bytes": len(message.payload),
                    "receiver": receiver,
                    "delivery": str(status),
                    "delivery_tick": tick,
                }

    def plot(self, tick: int = -1, axes: "Axes | None" = None) -> "Axes":
        """Draw one tick on a map and return the axes (matplotlib). A negative tick counts from the end.

        Raises InputError for a tick that was not recorded.
        """
        from mdrive_sumo.report.scenario_plot import draw_episode

        if not -len(self) <= tick < len(self):
            raise InputError(f"plot: tick: expected at most {len(self) - 1}, found {tick}")
        if axes is None:
            from matplotlib import pyplot

            _, axes = pyplot.subplots(figsize=(8, 8))
        draw_episode(axes, self.record, self.scenario, self.roads, tick % len(self))
        return axes

    def replay(self) -> ReplayPage:
        """Return the replay page of `mdrive-sumo view`; a notebook shows it inline, `.save(path)` writes it."""
        return ReplayPage.build(self.record, self.scenario, self.roads, self.result)

    def render(
        self,
        path: str | Path,
        *,
        view: ViewName = "top",
        follow: str | None = None,
        tick: int | None = None,
        first: int | None = None,
        last: int | None = None,
        size: tuple[int, int] | None = None,
        fps: int | None = None,
        speed: float = 1.0,
        messages: bool = True,
    ) -> Path:
        """Write a picture (.png) of one tick or a video (.gif; .mp4 with the program ffmpeg) and return its path.

        view: "top", "chase" from behind the CAV `follow`, or "driver". tick: of a picture; first, last: of a video.
        size: width and height in pixels. messages: lines for CPMs and MCMs. Defaults are those of `mdrive-sumo render`;
        an existing file is replaced. Raises InputError.
        """
        from mdrive_sumo.report.render.render_episodes import RenderedEpisode, render_episodes
        from mdrive_sumo.report.render.render_options import RenderOptions

        options = RenderOptions(view, follow, tick, first, last, size, fps, speed, messages, force=True)
        rendered = RenderedEpisode(self.record, self.scenario, self.roads, self.result)
        return render_episodes([rendered], Path(path), options)

    def export(self, format: str, out: str | Path) -> Path:
        """Write the episode in the format of another tool (docs/export.md) into a new or empty folder; return it.

        format: csv, parquet, fcd, scenarionet, commonroad, mcap or openscenario. Raises InputError.
        """
        from mdrive_sumo.export.export_run import export_recordings
        from mdrive_sumo.export.scored_recording import ScoredRecording

        recording = ScoredRecording(self.record, self.scenario, self.roads, self.result, self.scenario.id)
        return export_recordings([recording], format, Path(out))

    def save(self, path: str | Path) -> Path:
        """Write the recording (`.npz`), which `load_episode` reads; return its path."""
        save_episode(self.record, Path(path))
        return Path(path)


def load_episode(path: str | Path, suite: str | Suite | None = None) -> Episode:
    """Load a recording: RUN/episodes/SCENARIO.npz of a run folder, or a file written by `Episode.save`.

    suite: where its scenario is, by default the suite of the run folder or the packaged ones. Raises InputError.
    """
    path = Path(path)
    record = load_record(path)
    if suite is None and (path.parent.parent / "results.json").is_file():
        from mdrive_sumo.runs.stored_run import load_stored_run

        suite = load_stored_run(path.parent.parent).run.suite
    seed = record.about.get("seed", 0)
    if type(seed) is not int:
        raise InputError(f"{path}: about.seed: expected an integer, found {seed!r:.80}")
    scenario, roads, folder = find_scenario(record.scenario, suite, seed)
    return Episode(record, scenario, roads, seed, folder)
