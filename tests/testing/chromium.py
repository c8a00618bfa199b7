"""The browser of tests of pages. No tests in here."""

import os
import shutil
import time
from collections.abc import Iterator
from typing import Any

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
"""The shell needs a third of the processor time: it makes no windows, and no pages for their frames."""
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
FLAGS = (
    "--disable-gpu --disable-quic --no-first-run --disable-background-networking"
    " --disable-component-update --disable-sync"
)

COVERED = """() => {
    const covered = [];
    for (let tick = 0; tick < viewer.ticks; tick += 25) {
        viewer.seek(tick);
        for (let ego = 0; ego < viewer.replay.egos; ego++) {
            const at = viewer.screen(ego);
            const over = at && document.elementFromPoint(...at)?.closest("#map, .card");
            if (at && over?.id !== "map") covered.push([tick, ego, over?.id ?? "outside"]);
        }
    }
    return covered;
}"""
"""Every CAV at every second that lies under a card or outside of the window."""


def list_flags() -> list[str]:
    """Return the flags with which Chromium runs here, also as root."""
    return [*FLAGS.split(), *(["--no-sandbox"] if os.geteuid() == 0 else [])]


def list_gl_flags(gpu: bool = False) -> list[str]:
    """Return the flags with which Chromium has WebGL: drawn by SwiftShader on the processor, or by a graphics card."""
    drawer = (
        "--use-angle=gl-egl --ignore-gpu-blocklist" if gpu else "--use-angle=swiftshader --enable-unsafe-swiftshader"
    )
    return [flag for flag in list_flags() if flag != "--disable-gpu"] + drawer.split()


def list_fallback_flags() -> list[str]:
    """Return the flags with which Chromium draws as it does by itself without a graphics card.

    SwiftShader draws WebGL, and nothing else. With `list_gl_flags` it draws the page as well: single flushes of that
    hold up the GPU process, and so the next picture, for 1 to 1.3 s (a trace of the driving page on two busy cores).
    """
    return [flag for flag in list_gl_flags() if "--use-angle" not in flag] + ["--use-angle=swiftshader-webgl"]


def open_quietly(browser: Any, address: str, size: tuple[int, int] = (1280, 720)) -> Iterator[Any]:
    """Yield a fresh tab with a page; at the end, nothing may have been fetched or complained about."""
    tab = browser.new_page(viewport={"width": size[0], "height": size[1]})
    trouble: list[str] = []
    tab.on("console", lambda message: trouble.append(message.text))
    tab.on("pageerror", lambda error: trouble.append(str(error)))
    tab.on("request", lambda request: None if request.url.startswith("file:") else trouble.append(request.url))
    tab.goto(address)
    yield tab
    tab.close()
    assert trouble == []


def wait_until(frame: Any, expression: str, timeout_s: float = 10) -> None:
    """Wait until an expression of JavaScript is true in a page or a frame.

    `wait_for_function` evaluates it anew by `eval`, which the content policy of our pages refuses: it fails unless the
    expression is true at once.
    """
    end = time.monotonic() + timeout_s
    while not frame.evaluate(expression):
        assert time.monotonic() < end, f"not true within {timeout_s} s: {expression}"
        frame.wait_for_timeout(25)
