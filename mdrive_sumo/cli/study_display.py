"""Progress of a study on a terminal."""

from collections.abc import Mapping
from typing import TextIO

from mdrive_sumo.report.progress import ProgressDisplay
from mdrive_sumo.scoring import ScenarioResult


class StudyDisplay(ProgressDisplay):
    """Progress over all runs of a study."""

    def __init__(self, stream: TextIO, total: int) -> None:
        super().__init__(stream)
        self._total = total
        self._name = ""

    def run(self, name: str) -> None:
        """See StudyProgress."""
        self._name = name
        self.note(f"{name}:")

    def spared(self, scenarios: int) -> None:
        """See StudyProgress."""
        self._total -= scenarios

    def begin(self, total: int, kept: Mapping[str, ScenarioResult]) -> None:
        """See Progress: one of the study's runs begins."""
        self._kept += len(kept)
        self._results += kept.values()
        if kept:
            self.note(f"  {len(kept)} of {total} scenarios are done already")

    def _state(self) -> str:
        done = len(self._results)
        return f"{done:{len(str(self._total))}}/{self._total}  eta {self._time_left()}"
