"""Columns of the scalar metrics, which stand beside the score: speed, comfort, close encounters, messages."""

from dataclasses import dataclass

from server.api.schemas.submissions import FiguresOut


@dataclass(frozen=True, slots=True)
class ScalarColumn:
    """One scalar metric on boards and on pages of submissions."""

    name: str
    """Key in `FiguresOut.scalars`, and of the sort order."""
    title: str
    """Column header with unit."""
    decimals: int
    is_falling: bool
    """Whether sorting begins with the largest value."""

    def format_value(self, figures: FiguresOut) -> str:
        """Return the value as text; a dash where it is undefined or not disclosed."""
        value = self.find_value(figures)
        return "–" if value is None else f"{value:.{self.decimals}f}"

    def find_value(self, figures: FiguresOut) -> float | None:
        """Return the value; None where it is undefined or not disclosed."""
        return (figures.scalars or {}).get(self.name)


SCALAR_COLUMNS = (
    ScalarColumn("mean_speed", "Speed m/s", 2, True),
    ScalarColumn("comfort", "Comfort %", 1, True),
    ScalarColumn("min_ttc", "Least TTC s", 2, True),
    ScalarColumn("min_pet", "PET s", 1, True),
    ScalarColumn("message_rate", "Messages B/s", 0, False),
)
"""In the order of the columns."""
