"""Captions of a picture: agent, scenario, time, scores, and what happened in the last seconds."""

from dataclasses import dataclass

from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, End
from mdrive_sumo.report.palette import LIGHT
from mdrive_sumo.report.render.canvas import Align, Canvas, fade
from mdrive_sumo.report.render.rendered_episode import RenderedEpisode
from mdrive_sumo.report.replay_marks import ReplayMark

EVENT_TICKS = 3 * TICKS_PER_SECOND
"""How long an event is shown."""
MAX_EVENTS = 3
CARD = fade(LIGHT["card"], 0.88)
TEXT_SHARE, LEAST_TEXT_PX, MOST_TEXT_PX = 1 / 38, 10.0, 22.0
"""Size of captions relative to the height of the picture, and its limits."""


def choose_text_size(width: int, height: int) -> float:
    """Return the size of captions [px] on a picture."""
    return round(min(max(min(height, 0.7 * width) * TEXT_SHARE, LEAST_TEXT_PX), MOST_TEXT_PX), 1)


def list_shown_marks(marks: list[ReplayMark], tick: int) -> list[ReplayMark]:
    """Return the latest infractions and failures of the last seconds, the latest last."""
    recent = [mark for mark in marks if 0 <= tick - mark.tick < EVENT_TICKS and mark.kind != str(End.ARRIVED)]
    return recent[-MAX_EVENTS:]


@dataclass(frozen=True, slots=True)
class Captions:
    """Writes the captions of one episode onto its pictures."""

    episode: RenderedEpisode
    marks: list[ReplayMark]
    size_px: float

    def write(self, canvas: Canvas, tick: int) -> None:
        """Write all captions of a tick."""
        size, width = self.size_px, canvas.width
        events = list_shown_marks(self.marks, tick)
        result = self.episode.result
        clock = f"{tick * DT:.1f} s"
        self._write_card(canvas, (0.6 * size, 0.6 * size), self._shorten(canvas, self.episode.agent), LIGHT["ink"])
        self._write_card(canvas, (width - 0.6 * size, 0.6 * size), clock, LIGHT["ink"], "right")
        name = self._shorten(canvas, self.episode.scenario.id)
        self._write_card(canvas, (0.6 * size, 2.5 * size), name, LIGHT["muted"])
        for i, mark in enumerate(events):
            text = self._shorten(canvas, f"{mark.ego}: {mark.text}")
            self._write_card(canvas, (width / 2, (4.6 + 1.9 * i) * size), text, "#ffffff", "centre", LIGHT["bad"])
        scores = f"DS {result.ds:.1f}   SR {result.sr:.0f}   RC {result.rc:.1f}   IP {result.ip:.2f}"
        self._write_card(canvas, (0.6 * size, canvas.height - 2.3 * size), scores, LIGHT["ink"])

    def _write_card(
        self,
        canvas: Canvas,
        place: tuple[float, float],
        text: str,
        colour: str,
        align: Align = "left",
        card: str = CARD,
    ) -> None:
        """Write a line on a card; `place` is its upper left corner, upper middle or upper right corner."""
        size = self.size_px
        width = canvas.measure(text, size) + size
        left = place[0] - {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * width
        canvas.fill_card((left, place[1], left + width, place[1] + 1.7 * size), card)
        canvas.write(text, (left + 0.5 * size, place[1] + 1.22 * size), size, colour)

    def _shorten(self, canvas: Canvas, text: str) -> str:
        """Return a text that fits into three quarters of the picture's width."""
        room = 0.75 * canvas.width
        if canvas.measure(text, self.size_px) <= room:
            return text
        kept = max(1, int(len(text) * room / canvas.measure(text, self.size_px)) - 1)
        return text[:kept] + "…"
