"""TrainingOptions: what a training run is told, and the learning rate that follows from it."""

import math
from dataclasses import dataclass

from mdrive_sumo.agents.learned.system_spec import PLAN_HEADS
from mdrive_sumo.core import portable

WARM_UP_STEPS = 200
"""Steps over which the learning rate rises from 0."""


@dataclass(frozen=True, slots=True)
class TrainingOptions:
    """Steps, batch and seeds. Two runs with equal options on equal data and one device differ by rounding only."""

    steps: int = 8000
    batch: int = 256
    learning_rate: float = 1e-3
    weight_decay: float = 0.02
    seed: int = 0
    plan_head: str = PLAN_HEADS[0]
    average_decay: float = 0.998
    max_minutes: float | None = None
    """The run ends itself by then; the learning rate falls with whichever of steps and time is nearer to its end."""
    save_every_s: float = 60.0
    log_every: int = 100

    def find_progress(self, step: int, elapsed_s: float) -> float:
        """Return how much of the run is done, in [0, 1]."""
        by_time = elapsed_s / (60.0 * self.max_minutes) if self.max_minutes else 0.0
        return min(1.0, max(step / self.steps, by_time))

    def find_learning_rate(self, step: int, progress: float) -> float:
        """Return the learning rate: a warm-up, then half a cosine down to 2 % of the highest."""
        warm = min(1.0, (step + 1) / min(WARM_UP_STEPS, max(1, self.steps // 10)))
        return self.learning_rate * warm * (0.02 + 0.98 * 0.5 * (1.0 + portable.cos_sin(math.pi * progress)[0]))
