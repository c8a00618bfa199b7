"""Draws docs/images/drive.gif: `PYTHONPATH=tests python -m testing.driving_gif docs/images/drive.gif`.

A scripted driver drives a packaged scenario in the real page, pauses, goes back, asks what an agent would do, and
drives on from there. Each picture is shown for as long as it was seen: a slow machine makes a GIF with fewer of them.
"""

import io
import tempfile
import time
from pathlib import Path
from typing import Any

import click
from PIL import Image
from playwright.sync_api import sync_playwright

from testing.chromium import CHROMIUM, list_gl_flags, wait_until
from testing.drive_command import KeyDriver, run_drive

SIZE = (960, 540)
SHOWN = (560, 315)
"""Size of the GIF: a column of the documentation."""
COLOURS = 96
HOLD_MS = 1200
"""For how long what has to be read stays [ms]."""
BACK_TICK = 40
"""The tick to which the driver goes back: before the crossing."""


class _Film:
    def __init__(self, page: Any) -> None:
        self._page = page
        self.pictures: list[Image.Image] = []
        self.times_ms: list[int] = []
        self._at_s = time.monotonic()

    def take(self, shown_ms: int | None = None) -> None:
        """Take a picture; the one before was shown until now, unless its time is given."""
        now_s = time.monotonic()
        if self.times_ms and self.times_ms[-1] == 0:
            self.times_ms[-1] = max(40, round((now_s - self._at_s) * 1000))
        self._at_s = now_s
        taken = Image.open(io.BytesIO(self._page.screenshot(type="jpeg", quality=90))).convert("RGB")
        self.pictures.append(taken.resize(SHOWN, Image.Resampling.LANCZOS))
        self.times_ms.append(shown_ms or 0)

    def save(self, path: Path) -> None:
        self.times_ms[-1] = self.times_ms[-1] or HOLD_MS
        palette = self.pictures[len(self.pictures) // 2].quantize(COLOURS)
        first, *others = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in self.pictures]
        first.save(path, save_all=True, append_images=others, duration=self.times_ms, loop=0, optimize=True)


def _act(page: Any, film: _Film) -> None:
    driver = KeyDriver(page)
    film.take(HOLD_MS)
    driver.start()
    driver.drive_until(lambda: driver.tick >= 100, speed=4.0, look=(film.take,))
    page.keyboard.press("p")
    wait_until(page, "document.body.dataset.mode === 'paused'", 60)
    page.wait_for_timeout(500)
    film.take(HOLD_MS)
    for tick in range(95, BACK_TICK - 1, -5):
        page.evaluate(f"$('time').value = {tick}; $('time').dispatchEvent(new Event('input'))")
        page.wait_for_timeout(250)
        film.take(90)
    page.click("#do-what-if")
    wait_until(page, "Drive.rewind.ghosts.length > 0", 120)
    page.wait_for_timeout(500)
    film.take(2 * HOLD_MS)
    page.click("#do-branch")
    wait_until(page, "document.body.dataset.take === '2'", 60)
    page.wait_for_timeout(500)
    film.take(HOLD_MS)
    driver.start()
    driver.drive_until(lambda: driver.tick >= BACK_TICK + 40, speed=4.0, look=(film.take,))


@click.command()
@click.argument("path", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--scenario", default="i11_ins_sl_town", show_default=True)
def main(path: Path, scenario: str) -> None:
    """Draw the GIF of the tutorial."""
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list_gl_flags())
        with run_drive(scenario, "--out", f"{folder}/drive") as command:
            page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
            page.goto(next(iter(command.links.values())))
            wait_until(page, "Boolean(document.body.dataset.scene)", 60)
            page.wait_for_timeout(1500)
            film = _Film(page)
            _act(page, film)
            film.save(path)
        browser.close()
    click.echo(f"{path}: {len(film.pictures)} pictures, {sum(film.times_ms) / 1000:.1f} s, {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
