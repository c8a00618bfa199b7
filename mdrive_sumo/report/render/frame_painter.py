"""FramePainter: the picture of one tick of an episode, with its captions."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final

import numpy as np

from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, End
from mdrive_sumo.report.label_placement import LabelBox, LabelRequest, place_labels
from mdrive_sumo.report.palette import LIGHT
from mdrive_sumo.report.render.cameras import Camera
from mdrive_sumo.report.render.canvas import Align, Canvas, Pixels, fade
from mdrive_sumo.report.render.rendered_episode import RenderedEpisode, SignalStates
from mdrive_sumo.report.replay_marks import ReplayMark, find_marks

EVENT_TICKS = 3 * TICKS_PER_SECOND
"""How long an event is shown."""
MAX_EVENTS = 3
"""Events that are shown at once: more cards would cover the scene."""
CARD = fade(LIGHT["card"], 0.88)
TEXT_SHARE, LEAST_TEXT_PX, MOST_TEXT_PX = 1 / 38, 10.0, 22.0
"""Size of captions relative to the height of the picture, and its limits."""
FLASH_TICKS = TICKS_PER_SECOND
"""How long a contact glows after it ended, as in the replay."""
LINK_M = 1.5
"""[m] Height at which messages are drawn."""
LINK_OPACITY = 0.5
"""Roads and CAVs stay visible below the lines of messages."""
MARK_PX: Final = 5.0
"""[px] Radius of the disc where an infraction happened."""


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


class FramePainter(ABC):
    """Paints the ticks of an episode: what all views have in common, above a ground that each paints itself."""

    def __init__(self, episode: RenderedEpisode, size: tuple[int, int], messages: bool) -> None:
        self.episode, self.size, self.messages = episode, size, messages
        self.canvas = Canvas(*size)
        self.text_px = choose_text_size(*size)
        self.marks = find_marks(episode.record, episode.result)
        self.captions = Captions(episode, self.marks, self.text_px)
        self.signals = SignalStates(episode.record)

    def paint(self, tick: int) -> Pixels:
        """Return the picture (height, width, 3) of a tick."""
        camera = self.paint_world(tick)
        if self.messages:
            self._draw_links(camera, tick)
        self._draw_flashes(camera, tick)
        self._draw_marks(camera, tick)
        self._draw_labels(camera, tick)
        self.captions.write(self.canvas, tick)
        return self.canvas.to_array()

    @abstractmethod
    def paint_world(self, tick: int) -> Camera:
        """Paint ground and road users, and return the camera."""

    @abstractmethod
    def label_height(self, column: int) -> float:
        """Return the height [m] of the point that a CAV's label belongs to."""

    def _draw_links(self, camera: Camera, tick: int) -> None:
        """Draw the messages that arrived a moment ago, and the road-side units as discs."""
        for link in self.episode.list_links(tick):
            ends = camera.project_segment(np.column_stack((link.ends, (LINK_M, LINK_M))))
            if ends is not None:
                self.canvas.draw_line(ends, fade(LIGHT[link.type], LINK_OPACITY), 0.12 * self.text_px)

        for rsu in self.episode.scenario.rsus:
            pixel = camera.find_pixel((rsu.x, rsu.y, LINK_M))
            if pixel is not None:
                self.canvas.fill_disc(*pixel, 0.4 * self.text_px, LIGHT["muted"], "#ffffff")

    def _draw_flashes(self, camera: Camera, tick: int) -> None:
        """Draw a ring around every contact of the last second, larger and paler with its age."""
        latest = {
            (contact.ego, contact.other): contact_tick
            for contact_tick, contact in self.episode.record.contacts
            if 0 <= tick - contact_tick < FLASH_TICKS
        }
        for (ego, other), contact_tick in latest.items():
            share = (tick - contact_tick) / FLASH_TICKS
            x, y = self._find_contact(ego, other, contact_tick)
            pixel = camera.find_pixel((x, y, 0.5))
            if pixel is not None:
                radius = (0.9 + 1.6 * share) * self.text_px
                bad = LIGHT["bad"]
                self.canvas.fill_disc(*pixel, radius, fade(bad, 0.25 * (1 - share)), fade(bad, 1 - share), 3.0)

    def _find_contact(self, ego: str, other: str, tick: int) -> tuple[float, float]:
        """Return the point between the partners of a contact [m]."""
        ids = self.episode.record.ids
        places = [self.episode.find_pose(ids.index(name), tick)[:2] for name in (ego, other) if name in ids]
        x, y = np.array(places).mean(axis=0).tolist()
        return x, y

    def _draw_marks(self, camera: Camera, tick: int) -> None:
        for mark in list_shown_marks(self.marks, tick):
            pixel = camera.find_pixel((mark.x, mark.y, 0.0))
            if pixel is not None:
                self.canvas.fill_disc(*pixel, MARK_PX, LIGHT["bad"], "#ffffff", 2.0)

    def _draw_labels(self, camera: Camera, tick: int) -> None:
        """Write the names of CAVs on cards of their colour above them, so that none covers another one."""
        record, size = self.episode.record, 0.8 * self.text_px
        shown: list[tuple[int, float, float]] = []
        for column in (one for one in self.episode.list_present(tick) if one < record.egos):
            x, y, _ = self.episode.find_pose(column, tick)
            pixel = camera.find_pixel((x, y, self.label_height(column)))
            if pixel is not None and 0 <= pixel[0] <= self.size[0] and 0 <= pixel[1] <= self.size[1]:
                shown.append((column, *pixel))
        widths = [self.canvas.measure(record.ids[column], size) + 0.8 * size for column, _, _ in shown]
        requests = [
            LabelRequest(x, -y, width, 1.5 * size, self.label_clearance(camera))
            for (_, x, y), width in zip(shown, widths, strict=True)
        ]
        for (column, _, _), box in zip(shown, place_labels(requests, self.list_taken(camera, tick)), strict=True):
            self._write_label(record.ids[column], box, self.episode.colours[column], size)

    def list_taken(self, camera: Camera, tick: int) -> list[LabelBox]:  # noqa: ARG002
        """Return where no label may be (y up)."""
        return []

    def label_clearance(self, camera: Camera) -> float:  # noqa: ARG002
        """Return the distance [px] between a label and the point that it belongs to."""
        return 0.3 * self.text_px

    def _write_label(self, name: str, box: LabelBox, colour: str, size: float) -> None:
        left, top = box.x - box.width / 2, -box.y - box.height / 2
        self.canvas.fill_card((left, top, left + box.width, top + box.height), colour, "#ffffff")
        self.canvas.write(name, (box.x, top + 1.1 * size), size, "#ffffff", "centre")
