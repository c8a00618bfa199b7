"""The 3-D view in a browser: what its pixels show, against the camera model of sensors as an independent oracle."""

import base64
import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
import shapely
from testing.chromium import CHROMIUM, wait_until
from testing.viewer_crossing import crossing

from mdrive_sumo.contract import Objects, SemanticClass
from mdrive_sumo.contract.camera_rigs import build_camera_rig
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.scene_3d import pack_scene
from mdrive_sumo.report.view_3d_script import build_view_3d_script
from mdrive_sumo.sensing.camera.camera_model import ImageKind
from mdrive_sumo.sensing.camera.camera_renderer import Picture, load_renderer
from mdrive_sumo.sensing.camera.camera_sensor import read_camera_model
from mdrive_sumo.sensing.camera.instances import load_instances
from mdrive_sumo.sensing.camera.lighting import LIGHTS
from mdrive_sumo.sensing.camera.static_scene import build_scene_meshes, load_static_scene
from mdrive_sumo.sensing.sensing_frame import SensingFrame

pytestmark = [
    pytest.mark.slow,
    pytest.mark.costly_fixture,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium"),
]

ORIGIN = (10.0, -4.0)
AREA = shapely.box(-150.0, -150.0, 150.0, 150.0)
SIZE = (1280, 720)
FRONT, REAR, LEFT, RIGHT = (0, 0), (640, 0), (0, 360), (640, 360)
"""Upper left corners of the pictures of "four" on the canvas [px]."""
CAMERAS = dict(zip((FRONT, REAR, LEFT, RIGHT), map(read_camera_model, build_camera_rig("hitl")), strict=True))
HELPERS = """
window.draw = () => {
  view.draw(0.1);
  const gl = view.renderer.getContext();
  window.pixels = new Uint8Array(4 * view.width * view.height);
  gl.readPixels(0, 0, view.width, view.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
};
window.count = (wanted) => {
  let found = 0;
  for (let at = 0; at < pixels.length; at += 4) found += wanted(pixels[at], pixels[at + 1], pixels[at + 2]);
  return found;
};
/** Every fourth pixel of every fourth row of the upper left corner. */
window.sample = (width, height) => {
  const found = [];
  for (let y = 0; y < height; y += 4) for (let x = 0; x < width; x += 4) found.push(...pixel(x, y));
  return found;
};
window.pixel = (x, y) => [...pixels.subarray(4 * ((view.height - 1 - y) * view.width + x)).subarray(0, 3)];
/** Column and row of the first and behind the last pixel of the colour in a rectangle, and their number. */
window.find = ([red, green, blue], [left, top, width, height]) => {
  let [x0, y0, x1, y1, count] = [Infinity, Infinity, -Infinity, -Infinity, 0];
  for (let y = top; y < top + height; y++) {
    for (let x = left; x < left + width; x++) {
      const at = 4 * ((view.height - 1 - y) * view.width + x);
      const away = Math.abs(pixels[at] - red) + Math.abs(pixels[at + 1] - green) + Math.abs(pixels[at + 2] - blue);
      if (away > 60) continue;
      [x0, y0, x1, y1, count] = [Math.min(x0, x), Math.min(y0, y), Math.max(x1, x + 1), Math.max(y1, y + 1), count + 1];
    }
  }
  return [x0, y0, x1, y1, count];
};
"""
MAGENTA = [255, 0, 255]
PAIRS = {("driver", "night"), ("mirrors", "day"), ("chase", "rain"), ("top", "night"), ("four", "day")}
"""Each mode and each weather at least once: a mode places the cameras, a weather chooses colours."""


@pytest.fixture(scope="module")
def page(gl_browser: Any) -> Iterator[Any]:
    """A page with the view of the crossing, as `view`."""
    tab = gl_browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
    trouble: list[str] = []
    tab.on("pageerror", lambda error: trouble.append(str(error)))
    tab.set_content('<style>body { margin: 0 }</style><canvas id="c" width="1280" height="720"></canvas>')
    tab.add_script_tag(content=build_view_3d_script())
    tab.add_script_tag(content=HELPERS)
    packed = base64.b64encode(pack_scene(crossing(), AREA, "default", ORIGIN)).decode()
    tab.evaluate(
        """async (packed) => {
            window.scene = await decodeScene(Uint8Array.from(atob(packed), (c) => c.charCodeAt(0)).buffer);
            window.view = new View3D(document.getElementById("c"), scene, { quality: "high" });
        }""",
        packed,
    )
    yield tab
    tab.close()
    assert trouble == []


@pytest.fixture
def view(page: Any) -> Any:
    """The page without road users and overlays, by day."""
    page.evaluate("""() => {
        view.setWeather("day");
        for (const index of [...view.users.users.keys()]) view.remove(index);
        view.setOverlays({ route: [], shared: [], intentions: [], ghosts: [] });
    }""")
    return page


def put_lamp(view: Any, index: int, x: float, y: float, size: tuple[float, float, float]) -> None:
    """Put a block that shines in magenta: the lamp of a traffic light, with its corner (0, -0.5, 0) at x, y [m]."""
    view.evaluate("([i, x, y, size]) => view.place(i, 'lamp', [255, 0, 255], size, x, y, 0)", [index, x, y, list(size)])


def look(view: Any, x: float, y: float, yaw: float, mode: str, **more: Any) -> None:
    view.evaluate("(pose) => { view.look(pose); draw(); }", {"x": x, "y": y, "yaw": yaw, "mode": mode, **more})


def find(view: Any, colour: list[int], rect: tuple[int, int, int, int]) -> list[float]:
    return view.evaluate("([colour, rect]) => find(colour, rect)", [colour, list(rect)])


@pytest.mark.parametrize(
    ("picture", "ahead", "left", "size"),
    [
        (FRONT, 14.0, 0.5, (0.5, 1.0, 1.6)),
        (FRONT, 60.0, -5.0, (3.0, 3.0, 3.0)),
        (REAR, -18.0, 5.0, (1.0, 1.0, 1.0)),
        (LEFT, 2.0, 12.0, (1.0, 1.5, 2.0)),
        (RIGHT, 3.0, -9.0, (0.6, 0.6, 0.9)),
    ],
)
def test_objects_are_where_the_camera_model_projects_them(
    view: Any, picture: tuple[int, int], ahead: float, left: float, size: tuple[float, float, float]
) -> None:
    x, y, yaw = -60.0, -5.0, 0.3
    cos, sin = math.cos(yaw), math.sin(yaw)
    place = x + cos * ahead - sin * left, y + sin * ahead + cos * left
    put_lamp(view, 1, *place, size)
    look(view, x, y, yaw, "four")
    found = find(view, MAGENTA, (*picture, 640, 360))
    model = CAMERAS[picture]
    corners = [
        (place[0] + dx * size[0], place[1] + dy * size[1], dz * size[2])
        for dx in (0, 1)
        for dy in (-0.5, 0.5)
        for dz in (0, 1)
    ]
    seen = model.project(model.find_view(x, y, yaw), np.array(corners))
    expected = np.concatenate((seen[:, :2].min(0), seen[:, :2].max(0))) + np.tile(picture, 2)
    assert found[:4] == pytest.approx(expected, abs=1.5)
    others = [corner for corner in CAMERAS if corner != picture]
    assert sum(find(view, MAGENTA, (*corner, 640, 360))[4] for corner in others) == 0


def test_lights_show_the_signal(view: Any) -> None:
    _, lamps = build_scene_meshes(crossing(), AREA, np.array((*ORIGIN, 0.0)))
    index = lamps.names.index("c:0")
    place, facing = lamps.place[index], lamps.turn[index]
    x, y = (place[:2] + 14.0 * facing).tolist()
    yaw = math.atan2(-facing[1], -facing[0])
    model = CAMERAS[FRONT]
    shown: dict[str, Any] = {}
    for letter, height in (("r", 0.69), ("y", 0.38), ("G", 0.07), ("O", 0.07)):
        view.evaluate("(letter) => view.setSignals({ c: letter.repeat(8) })", letter)
        look(view, x, y, yaw, "four")
        column, row, _ = model.project(model.find_view(x, y, yaw), place + np.array((0.0, 0.0, height + 0.12))).tolist()
        shown[letter] = view.evaluate("([x, y]) => pixel(x, y)", [int(column), int(row)])
    assert shown["r"][0] > 200 and max(shown["r"][1:]) < 90
    assert min(shown["y"][:2]) > 160 and shown["y"][2] < 90
    assert shown["G"][1] > 190 and shown["G"][0] < 90
    assert max(shown["O"]) < 90, "dark"


def test_the_picture_is_like_that_of_the_camera_renderer(view: Any) -> None:
    """Of each kind of surface the median colour, from the same place; the view's road has a grain of its own."""
    model = CAMERAS[FRONT]
    try:
        draw = load_renderer().draw
    except InputError as error:
        pytest.skip(str(error))
    scene = load_static_scene(crossing())
    nobody = SensingFrame(0, Objects.empty(), {})
    x, y, yaw = -40.0, -5.0, 0.35
    camera_view = model.find_view(x + ORIGIN[0], y + ORIGIN[1], yaw)
    heading = np.array((math.cos(yaw), math.sin(yaw)))
    for weather in ("day", "night", "rain"):
        view.evaluate("(name) => view.setWeather(name)", weather)
        view.evaluate("view.setSignals({ c: 'OOOOOOOO' })")
        look(view, x, y, yaw, "four")
        picture = Picture(model, camera_view, scene, load_instances(nobody, scene), LIGHTS[weather], heading)
        expected, classes = draw(picture), draw(replace(picture, model=replace(model, kind=ImageKind.SEMANTIC)))
        shown = np.array(view.evaluate("sample(640, 360)")).reshape(90, 160, 3)
        for kind in (SemanticClass.ROAD, SemanticClass.BUILDING, SemanticClass.SKY, SemanticClass.TERRAIN):
            where = classes[::4, ::4] == kind
            assert where.sum() > 100, kind
            difference = np.median(shown[where], axis=0) - np.median(expected[::4, ::4][where], axis=0)
            assert np.abs(difference).max() < 16, (weather, kind, difference)


def test_a_house_hides_objects_and_no_overlays(view: Any) -> None:
    """The house covers x from 20 m to 40 m, y from 20 m to 40 m of the world."""
    x, y = -ORIGIN[0], 30.0 - ORIGIN[1]
    put_lamp(view, 1, 45.0 - ORIGIN[0], y, (2.0, 2.0, 2.0))
    look(view, x, y, 0.0, "driver")
    assert find(view, MAGENTA, (0, 0, *SIZE))[4] == 0
    box = {"x": 46.0 - ORIGIN[0], "y": y, "yaw": 0, "length": 4.0, "width": 2.0, "from": "cav_1", "colour": "#ff00ff"}
    view.evaluate("(box) => view.setOverlays({ shared: [box] })", box)
    look(view, x, y, 0.0, "driver")
    assert find(view, MAGENTA, (0, 0, *SIZE))[4] > 30
    put_lamp(view, 2, 15.0 - ORIGIN[0], y, (2.0, 2.0, 2.0))
    view.evaluate("view.setOverlays({ shared: [] })")
    look(view, x, y, 0.0, "driver")
    assert find(view, MAGENTA, (0, 0, *SIZE))[4] > 5000


def test_mirrors_show_what_is_behind_with_left_and_right_exchanged(view: Any) -> None:
    put_lamp(view, 1, -90.0, 6.0, (1.0, 4.0, 3.0))  # behind, to the left
    look(view, -60.0, 0.0, 0.0, "mirrors")
    inside = find(view, MAGENTA, (488, 16, 304, 90))
    assert inside[4] > 20 and inside[2] < 640, "in the left half of the mirror"
    assert find(view, MAGENTA, (20, 434, 216, 134))[4] > 20, "in the left mirror"
    assert find(view, MAGENTA, (1044, 434, 216, 134))[4] == 0


def test_what_is_removed_is_gone_and_the_own_car_hides_nothing(view: Any) -> None:
    put_lamp(view, 1, -40.0, -0.0, (1.0, 1.0, 1.0))
    put_lamp(view, 0, -60.5, 0.0, (4.0, 2.0, 3.0))
    look(view, -60.0, 0.0, 0.0, "four", own=0)
    assert 0 < find(view, MAGENTA, (0, 0, *SIZE))[4] < 2000
    view.evaluate("view.remove(1)")
    look(view, -60.0, 0.0, 0.0, "four", own=0)
    assert find(view, MAGENTA, (0, 0, *SIZE))[4] == 0


def test_a_camera_behind_a_car_stays_out_of_houses(view: Any) -> None:
    x, y = 45.0 - ORIGIN[0], 30.0 - ORIGIN[1]
    behind = """([x, y, yaw]) => {
        view.look({ x, y, yaw, mode: 'chase' });
        draw();
        return [view.cameras.main.x, view.cameras.main.y];
    }"""
    near = view.evaluate(behind, [x, y, 0.0])
    assert near[0] > 40.0 - ORIGIN[0] and near[1] == pytest.approx(y)
    far = view.evaluate(behind, [x, y, math.pi])
    assert far[0] == pytest.approx(x + 11.0)


@pytest.mark.parametrize(
    ("mode", "weather"),
    [
        pytest.param(mode, weather, marks=() if (mode, weather) in PAIRS else pytest.mark.full)
        for mode, weather in product(("driver", "mirrors", "chase", "top", "four"), ("day", "night", "rain"))
    ],
)
def test_every_mode_draws_sky_or_ground_everywhere(view: Any, mode: str, weather: str) -> None:
    """A canvas that nothing has painted is black; at night the ground is not."""
    view.evaluate("(name) => view.setWeather(name)", weather)
    look(view, -60.0, 0.0, 0.0, mode)
    unpainted = view.evaluate("count((red, green, blue) => red + green + blue === 0)")
    assert unpainted < 12_000, "frames of mirrors are black"


def test_brake_lamps_and_weather_change_the_picture(view: Any) -> None:
    light: dict[str, list[int]] = {}
    for weather in ("day", "dusk", "night", "fog"):
        view.evaluate("(name) => view.setWeather(name)", weather)
        look(view, -60.0, 0.0, 0.0, "driver")
        light[weather] = view.evaluate("pixel(640, 40)")
    assert sum(light["night"]) < sum(light["dusk"]) < sum(light["day"])
    assert max(light["fog"]) - min(light["fog"]) < 25, "grey"
    view.evaluate("view.setWeather('day')")
    red: list[int] = []
    for lamps in (0, 1):
        view.evaluate("(lamps) => view.place(1, 'car', [20, 20, 20], [4.6, 1.85, 1.5], -50, 0, 0, lamps)", lamps)
        look(view, -60.0, 0.0, 0.0, "driver")
        red.append(find(view, [255, 33, 20], (0, 0, *SIZE))[4])
    assert red[0] == 0 and red[1] > 100


def test_ghosts_and_routes_are_shown(view: Any) -> None:
    look(view, -60.0, -1.75, 0.0, "driver")
    before = view.evaluate("pixel(640, 420)")
    view.evaluate("view.setOverlays({ route: [[-60, -1.75], [-20, -1.75]] })")
    look(view, -60.0, -1.75, 0.0, "driver")
    after = view.evaluate("pixel(640, 420)")
    assert after[2] > before[2] + 40, "a blue ribbon"
    ghost = {"model": "car", "paint": [0, 255, 0], "size": [4.6, 1.85, 1.5], "x": -45, "y": -1.75, "yaw": 0}
    view.evaluate("(ghost) => view.setOverlays({ route: [], ghosts: [ghost] })", ghost)
    look(view, -60.0, -1.75, 0.0, "driver")
    greener = view.evaluate("count((red, green) => green > red + 60)")
    assert greener > 500


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        ("view.setWeather('hail')", "unknown weather hail"),
        ("view.place(1, 'tram', [0, 0, 0], [1, 1, 1], 0, 0, 0)", "unknown model tram"),
        ("view.setOverlays({ halo: [] })", "unknown overlay halo"),
    ],
)
def test_bad_input_is_one_sentence(view: Any, call: str, sentence: str) -> None:
    assert sentence in view.evaluate(
        f"() => {{ try {{ {call}; return ''; }} catch (error) {{ return error.message; }} }}"
    )


def test_a_browser_without_webgl_says_so(page: Any) -> None:
    message = page.evaluate("""() => {
        const canvas = document.createElement("canvas");
        canvas.getContext = () => null;
        try { new View3D(canvas, scene, { quality: "low" }); return ""; } catch (error) { return error.message; }
    }""")
    assert message.startswith("This browser has no WebGL 2")


def test_a_slow_machine_draws_fewer_pixels(view: Any) -> None:
    widths = view.evaluate("""() => {
        const found = [view.width];
        for (let i = 0; i < 8; i++) view.judge(60);
        found.push(view.width);
        for (let i = 0; i < 80; i++) view.judge(60);
        found.push(view.width);
        view.ratio = 1;
        view.resize(1280, 720);
        return [...found, view.width];
    }""")
    assert widths == [1280, 1088, 960, 1280]


def test_a_picture_is_ready_once_it_is_drawn(view: Any) -> None:
    look(view, -60.0, 0.0, 0.0, "driver")
    wait_until(view, "view.isReady()")
