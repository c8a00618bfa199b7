"""Speed of the 3-D view in Chromium: `python tests/bench/view_3d.py`.

A CAV drives through a packaged scenario with 80 road users that move along the lanes around it. Without a GPU Chromium
draws with SwiftShader, on the cores that it finds. Each line is one mode: frames that were drawn to their end in a
second, and for one of them the processor time of all of Chromium's processes, and the time of the page's own script.
"""

import base64
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
import numpy as np
from playwright.sync_api import sync_playwright

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.report.scene_3d import describe_road_user, find_scene_area, pack_scene
from mdrive_sumo.report.view_3d_script import build_view_3d_script
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.suite import load_suite

sys.path.insert(0, str(Path(__file__).parents[1]))
from testing.chromium import CHROMIUM, list_gl_flags

NEAR_M = 150.0
"""[m] Lanes within this distance of the route carry the road users."""
KINDS = (
    *((Kind.VEHICLE, 4.6, 1.85),) * 7,
    *((Kind.VEHICLE, 6.2, 2.1), (Kind.VEHICLE, 12.0, 2.5), (Kind.PEDESTRIAN, 0.5, 0.5), (Kind.CYCLIST, 1.8, 0.6)),
)
PAGE = """<!doctype html><style>body {{ margin: 0 }} canvas {{ width: 100vw; height: 100vh; display: block }}</style>
<canvas id="view"></canvas><script>{script}</script><script>
const [packed, users, route] = {data};
const along = (line, metres) => {{
  let left = metres % line.length_m;
  for (let i = 1; i < line.points.length; i++) {{
    const [[ax, ay], [bx, by]] = [line.points[i - 1], line.points[i]];
    const size = Math.hypot(bx - ax, by - ay);
    if (left <= size) {{
      const share = left / size;
      return [ax + share * (bx - ax), ay + share * (by - ay), Math.atan2(by - ay, bx - ax)];
    }}
    left -= size;
  }}
  return [...line.points[0], 0];
}};
window.prepare = async (weather, quality) => {{
  const bytes = Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0));
  window.view = new View3D(document.getElementById("view"), await decodeScene(bytes.buffer), {{ weather, quality }});
  return `${{view.rendererName}}, quality ${{view.qualityName}},`;
}};
window.measure = (mode, seconds) => new Promise((done) => {{
  const begin = performance.now();
  const draws = [];
  let frames = 0;
  const frame = () => {{
    const now = (performance.now() - begin) / 1000;
    const median = draws.sort((a, b) => a - b)[frames >> 1];
    if (now >= seconds) return done({{ frames, fps: frames / now, draw_ms: median, ...view.info }});
    requestAnimationFrame(frame);
    if (!view.isReady()) return;
    users.forEach(([look, size, line, start], i) => {{
      const [x, y, yaw] = along(line, start + 8 * now);
      view.place(i + 1, look[0], look[1], size, x, y, yaw, i % 8);
    }});
    const [x, y, yaw] = along(route, 8 * now);
    view.place(0, "car", [200, 200, 205], [4.9, 1.9, 1.5], x, y, yaw, 1);
    view.look({{ x, y, yaw, mode, own: 0 }});
    view.setOverlays({{ route: route.points }});
    const before = performance.now();
    view.draw();
    draws.push(performance.now() - before);
    frames++;
  }};
  requestAnimationFrame(frame);
}});
</script>"""


def write_page(suite: str, scenario_id: str, users: int) -> str:
    """Return the page with the scene of a scenario and lanes for the road users."""
    loaded = load_suite(suite)
    scenario = loaded.select(scenario_id or "*")[0]
    roads = load_road_map(find_network_folder(scenario.network, loaded.find_folder(scenario.id)))
    route = np.concatenate([ego.xy for ego in scenario.egos])
    origin = np.rint(route[0])
    packed = pack_scene(roads, find_scene_area(route), "default", origin.tolist())
    rows = list(place_users(roads, route, origin, users))
    data = [base64.b64encode(packed).decode(), rows, describe_line(scenario.egos[0].xy, origin)]
    click.echo(
        f"{scenario.id}: scene {len(packed) / 1000:.1f} kB packed, script {len(build_view_3d_script()) / 1000:.0f} kB"
    )
    return PAGE.format(script=build_view_3d_script(), data=json.dumps(data))


def place_users(roads: RoadMap, route: Float, origin: Float, users: int) -> Any:
    """Yield look, size, lane and place along it [m] of each road user."""
    random = np.random.default_rng(1)
    ends = [lane.centre.xy for lane in roads.driving]
    lines = [xy for xy in ends if np.hypot(*(route - xy[len(xy) // 2]).T).min() < NEAR_M and lane_length(xy) > 15.0]
    for i in range(users):
        kind, length, width = KINDS[i % len(KINDS)]
        look = describe_road_user(f"user_{i}", kind, length, width)
        line = describe_line(lines[int(random.integers(len(lines)))], origin)
        yield [look.model, look.paint], [length, width, look.height], line, float(random.uniform(0, 200))


def lane_length(xy: Float) -> float:
    """Length of a line (N, 2) [m]."""
    return float(np.hypot(*np.diff(xy, axis=0).T).sum())


def describe_line(xy: Float, origin: Float) -> dict[str, Any]:
    """Return a line (N, 2) for the page."""
    return {"points": np.round(xy - origin, 2).tolist(), "length_m": lane_length(xy)}


def measure_processor_s() -> float:
    """Processor time [s] of all processes that descend from this one."""
    parents: dict[int, int] = {}
    ticks: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text("utf-8").rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        parents[int(stat.parent.name)], ticks[int(stat.parent.name)] = int(fields[1]), int(fields[11]) + int(fields[12])
    return sum(ticks[pid] for pid in ticks if descends(pid, parents)) / os.sysconf("SC_CLK_TCK")


def descends(pid: int, parents: dict[int, int]) -> bool:
    """Return whether a process descends from this one."""
    while pid in parents and pid != os.getpid():
        pid = parents[pid]
    return pid == os.getpid()


@click.command()
@click.option("--suite", default="mdrive", show_default=True)
@click.option("--scenario", default="", help="Default: the first of the suite.")
@click.option("--users", default=80, show_default=True)
@click.option("--seconds", default=5.0, show_default=True, help="Of each mode.")
@click.option("--size", default="1280x720", show_default=True)
@click.option("--quality", type=click.Choice(["high", "low"]), help="Default: what the page chooses.")
@click.option("--weather", default="default", show_default=True)
@click.option("--modes", default="driver,mirrors,chase,top,four", show_default=True)
@click.option("--gpu", is_flag=True, help="Let Chromium use a graphics card.")
def main(
    suite: str,
    scenario: str,
    users: int,
    seconds: float,
    size: str,
    quality: str | None,
    weather: str,
    modes: str,
    gpu: bool,
) -> None:
    """Measure frames per second in each mode."""
    if CHROMIUM is None:
        click.echo("skipped: it needs Chromium")
        return
    width, height = map(int, size.split("x"))
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder) / "view.html"
        path.write_text(write_page(suite, scenario, users), "utf-8")
        flags = list_gl_flags(gpu=gpu)
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        tab = browser.new_page(viewport={"width": width, "height": height})
        tab.on("pageerror", lambda error: click.echo(f"error: {error}"))
        tab.goto(path.as_uri())
        drawer = tab.evaluate("([w, q]) => prepare(w, q ?? undefined)", [weather, quality])
        click.echo(f"drawn by {drawer} at {size}, {users} users")
        for mode in modes.split(","):
            tab.evaluate("([mode]) => measure(mode, 0.5)", [mode])  # shaders are compiled
            begin = measure_processor_s()
            row = tab.evaluate("([mode, seconds]) => measure(mode, seconds)", [mode, seconds])
            processor_ms = 1000 * (measure_processor_s() - begin) / row["frames"]
            click.echo(
                f"{mode:8} {row['fps']:6.1f} frames/s, {processor_ms:6.1f} ms of processors and {row['draw_ms']:4.1f} "
                f"ms of the page in a frame, {row['calls']} calls, {row['triangles']} triangles"
            )
        browser.close()


if __name__ == "__main__":
    main()
