"""Progress of an evaluation: one live line on a terminal, one line per scenario elsewhere."""

import time
from collections.abc import Callable, Iterable, Mapping
from shutil import get_terminal_size
from statistics import fmean
from typing import TextIO

from mdrive_sumo.core.clean_text import clean_for_terminal, clean_line
from mdrive_sumo.core.terminal import CLEAR_LINE
from mdrive_sumo.scoring import EpisodeKey, ScenarioResult

BAR_WIDTH = 24
RUNNING_LINE_INTERVAL_S = 60.0
"""How often a line in a log says that episodes are still running [s]."""


class ProgressDisplay:
    """Implements `runs.evaluate.Progress` on a text stream."""

    def __init__(self, stream: TextIO | None, clock: Callable[[], float] = time.monotonic) -> None:
        """stream: None discards everything. clock: time [s] for the estimate of the time left."""
        self._stream, self._clock = stream, clock
        self._live = stream is not None and stream.isatty()
        self._total = self._kept = 0
        self._results: list[ScenarioResult] = []
        self._began = clock()
        self._running_shown_s = self._began

    def begin(self, total: int, kept: Mapping[EpisodeKey, ScenarioResult]) -> None:
        """See Progress."""
        self._total, self._kept = total, len(kept)
        self._results = list(kept.values())
        self._began = self._clock()
        if kept and len(kept) < total:
            self.note(f"continuing: {len(kept)} of {total} scenarios are done already")
        if len(kept) == total:
            self.note("already complete; --fresh runs it again")
        self._draw("")

    def done(self, result: ScenarioResult) -> None:
        """See Progress."""
        self._results.append(result)
        if self._live:
            self._draw(_name(result))
        else:
            self._write(f"{self._state()}  {_name(result)} {_brief(result)}\n")

    def show_running(self, running: Mapping[str, float]) -> None:
        """See Progress. Elsewhere than on a terminal a line comes at most every minute."""
        if self._live:
            self._draw(_describe_running(running))
        elif self._clock() - self._running_shown_s >= RUNNING_LINE_INTERVAL_S:
            self._running_shown_s = self._clock()
            self._write(f"{self._state()}  {_describe_running(running)}\n")

    def note(self, text: str) -> None:
        """See Progress."""
        self._write((CLEAR_LINE if self._live else "") + clean_for_terminal(text) + "\n")
        self._draw("")

    def close(self) -> None:
        """Clear the live line."""
        if self._live:
            self._write(CLEAR_LINE)

    def _draw(self, last: str) -> None:
        if self._live and self._total:
            full = BAR_WIDTH * len(self._results) // self._total
            bar = "█" * full + "░" * (BAR_WIDTH - full)
            width = max(get_terminal_size().columns, 40)
            self._write(CLEAR_LINE + f"{bar} {self._state()}  {clean_line(last)}"[: width - 1])

    def _state(self) -> str:
        done = len(self._results)
        if not done:
            return f"{done}/{self._total}"
        means = f"DS {_mean(r.ds for r in self._results)}  SR {_mean(r.sr for r in self._results)}"
        return f"{done:{len(str(self._total))}}/{self._total}  {means}  eta {self._time_left()}"

    def _count_done(self) -> int:
        return len(self._results)

    def _time_left(self) -> str:
        fresh = self._count_done() - self._kept
        if not fresh:
            return "-:--"
        left_s = (self._clock() - self._began) / fresh * (self._total - self._count_done())
        return _format_duration(left_s)

    def _write(self, text: str) -> None:
        if self._stream is not None:
            self._stream.write(text)
            self._stream.flush()


def _mean(values: Iterable[float]) -> str:
    return f"{fmean(values):5.1f}"


def _name(result: ScenarioResult) -> str:
    return clean_line(f"{result.id} seed {result.seed}" if result.seed else result.id)


def _describe_running(running: Mapping[str, float]) -> str:
    """Return "running: i1 for 2:05, i2 for 1:10"; one more number counts those that are left out."""
    texts = [f"{name} for {_format_duration(seconds)}" for name, seconds in running.items()]
    left_out = f", {len(texts) - 3} more" if len(texts) > 3 else ""
    return f"running: {', '.join(texts[:3])}{left_out}"


def _format_duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02}"


def _brief(result: ScenarioResult) -> str:
    return clean_line(f"void: {result.reason}") if result.status == "void" else f"DS {result.ds:.1f}"
