"""Key to picture and pictures a second of `mdrive-sumo drive` in Chromium: `python tests/bench/drive_latency.py`.

A scripted driver presses and releases pedals and steering keys while the car drives. A key's time goes from the event's
own time stamp until the picture with it is drawn to its end; what browser and screen add to show it is not in it. Rows
differ in the added delay of a proxy between browser and server, half of it each way. Without a GPU Chromium draws WebGL
with SwiftShader, on the cores that the simulation needs as well, and pages in software, as it does where people have no
graphics card.
"""

import asyncio
import os
import platform
import statistics
import sys
import tempfile
import threading
from collections.abc import Generator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import click
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))
from testing.chromium import CHROMIUM, list_fallback_flags, list_gl_flags, wait_until
from testing.drive_command import KeyDriver, run_drive

MEASURE = """() => {
    window.measured = [];
    window.begun = [Drive.pictures, performance.now()];
    const gl = Drive.picture.view === "top" ? undefined : Drive.picture.view3d.renderer.getContext();
    const finish = (then) => {
        if (!gl) return requestAnimationFrame(then);
        const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
        gl.flush();
        const look = () => (gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED ? then() : setTimeout(look, 1));
        return setTimeout(look, 0);
    };
    addEventListener("keydown", (event) => {
        if (event.repeat || Drive.mode !== "driving") return;
        const before = Drive.pictures;
        const look = () => {
            if (Drive.pictures === before) return requestAnimationFrame(look);
            return finish(() => window.measured.push(performance.now() - event.timeStamp));
        };
        requestAnimationFrame(look);
    }, true);
}"""
"""The page reads the keys, then draws: one more large picture means that it was drawn after the key. A fence tells when
the graphics driver has drawn it to its end; the page itself draws the top view, until the next animation frame."""
VIEWS = {"driver": "1", "top": "4"}
"""Keys that choose a view."""
KEYS = ("w", "a", "s", "d")
PRESS_MS, REST_MS = 60, 90
"""A key is held and released for so long [ms]: no multiple of a picture or a tick, so presses fall anywhere in both."""


async def _pass(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, delay_s: float) -> None:
    """Pass bytes on, each some time after it came."""
    loop = asyncio.get_running_loop()
    try:
        while data := await reader.read(2**16):
            loop.call_later(delay_s, writer.write, data)
    except ConnectionError:
        pass
    loop.call_later(delay_s, writer.close)


async def _serve_proxy(port: int, delay_s: float, ready: Any) -> None:
    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", port)
        await asyncio.gather(_pass(reader, far_writer, delay_s), _pass(far_reader, writer, delay_s))

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    ready(server.sockets[0].getsockname()[1])
    await server.serve_forever()


@contextmanager
def delay_network(port: int, delay_ms: float) -> Generator[int]:
    """Yield the port of a proxy that adds a delay to the way there and back together."""
    if not delay_ms:
        yield port
        return
    found: list[int] = []
    is_ready = threading.Event()

    def note(number: int) -> None:
        found.append(number)
        is_ready.set()

    work = _serve_proxy(port, delay_ms / 2000, note)
    threading.Thread(target=lambda: asyncio.run(work), daemon=True).start()
    is_ready.wait(10)
    yield found[0]


def describe(times: list[float]) -> str:
    """Return median and 95th percentile."""
    if len(times) < 2:
        return "too few"
    return f"median {statistics.median(times):6.1f} ms   p95 {statistics.quantiles(times, n=20)[-1]:6.1f} ms"


def measure(browser: Any, link: str, delay_ms: float, presses: int, view: str) -> None:
    """Drive and print one row."""
    parts = urlsplit(link)
    with delay_network(parts.port or 0, delay_ms) as port:
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(link.replace(f":{parts.port}/", f":{port}/"))
        wait_until(page, "Boolean(document.body.dataset.scene)", 60)
        driver = KeyDriver(page)
        driver.start()
        wait_until(page, "document.body.dataset.mode === 'driving'", 60)
        page.keyboard.press(VIEWS[view])
        page.evaluate(MEASURE)
        for i in range(presses):
            if driver.mode != "driving":
                break
            page.keyboard.down(KEYS[i % len(KEYS)])
            page.wait_for_timeout(PRESS_MS)
            page.keyboard.up(KEYS[i % len(KEYS)])
            page.wait_for_timeout(REST_MS)
        rate = page.evaluate("1000 * (Drive.pictures - begun[0]) / (performance.now() - begun[1])")
        times = page.evaluate("measured")
        facts = page.evaluate(
            "[document.body.dataset.tick, Drive.picture.view3d?.rendererName ?? 'no WebGL', Drive.connection.latency]"
        )
        page.close()
    click.echo(
        f"{view:6} view, added {delay_ms:3.0f} ms: key to picture {describe(times)} ({len(times)} keys),"
        f" {rate:5.1f} pictures/s, tick {facts[0]}, to the server and back {facts[2]:.1f} ms; {facts[1]}"
    )


@click.command()
@click.option("--scenario", default="i11_ins_sl_town", show_default=True)
@click.option("--view", type=click.Choice(list(VIEWS)), multiple=True, default=list(VIEWS), show_default=True)
@click.option("--gpu", is_flag=True, help="Draw with a graphics card.")
@click.option("--presses", default=100, show_default=True)
@click.option("--delay", "delays", multiple=True, type=float, default=(0.0, 150.0, 300.0), show_default=True)
def main(scenario: str, view: tuple[str, ...], gpu: bool, presses: int, delays: tuple[float, ...]) -> None:
    """Measure key to picture and pictures a second."""
    if CHROMIUM is None:
        click.echo("skipped: it needs Chromium")
        return
    load = f"load {os.getloadavg()[0]:.1f} at the start"
    click.echo(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {load}; 1280x720")
    with sync_playwright() as playwright:
        flags = list_gl_flags(gpu) if gpu else list_fallback_flags()
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        for name, delay_ms in product(view, delays):
            with tempfile.TemporaryDirectory() as folder, run_drive(scenario, "--out", f"{folder}/drive") as command:
                measure(browser, next(iter(command.links.values())), delay_ms, presses, name)
        browser.close()


if __name__ == "__main__":
    main()
