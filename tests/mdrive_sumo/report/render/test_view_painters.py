"""What is on pictures from above and in perspective, at pixels that are computed here."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgb
from testing.viewer_crossing import crossing, record, scenario

from mdrive_sumo.contract import Message
from mdrive_sumo.core.state import End
from mdrive_sumo.report.palette import CAV_COLOURS, LIGHT
from mdrive_sumo.report.render.cameras import Rings
from mdrive_sumo.report.render.canvas import Canvas, Pixels
from mdrive_sumo.report.render.frame_painter import choose_text_size
from mdrive_sumo.report.render.perspective_painters import ABOVE_M, AIM_M, BEHIND_M, ChaseViewPainter
from mdrive_sumo.report.render.rendered_episode import RenderedEpisode
from mdrive_sumo.report.render.top_view_painter import FOLLOWED_M, TopViewPainter
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage

SIZE = 640, 480


def make_episode(ticks: int = 40, actors: int = 3) -> RenderedEpisode:
    """Two CAVs; the first collides half-way."""
    hit = Infraction(kind="collision-vehicle", tick=ticks // 2, x=-60.0, y=-1.7, factor=0.6, other="cav_1")
    same = {"ds": 60.0, "rc": 100.0, "ip": 0.6}
    egos = (
        EgoResult(id="cav_0", outcome=End.ARRIVED, reason="", infractions=(hit,), **same),
        EgoResult(id="cav_1", outcome=End.AGENT_FAILED, reason="", infractions=(), **same),
    )
    result = ScenarioResult(
        id="crossing-4", bucket="InterDrive", category="crossing", seed=0, status="ok", reason="", min_ttc=None,
        digest="", ticks=ticks, egos=egos, sr=0.0, **same,
    )  # fmt: skip
    return RenderedEpisode(record(ticks=ticks, actors=actors), scenario(2), crossing(), result)


@pytest.fixture(scope="module")
def episode() -> RenderedEpisode:
    return make_episode()


def colour_at(picture: Pixels, x: float, y: float) -> tuple[int, int, int]:
    red, green, blue = picture[round(y), round(x)].tolist()
    return red, green, blue


def as_bytes(colour: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return red, green, blue


def test_a_picture_from_above_has_everything_at_its_place(episode: RenderedEpisode) -> None:
    """Around CAV 0, which drives along +x: pixels are metres times the scale, with north up."""
    picture = TopViewPainter(episode, SIZE, True, 0).paint(3)
    x, y, _ = episode.find_pose(0, 3)
    scale = SIZE[1] / FOLLOWED_M

    def at(metres_x: float, metres_y: float) -> tuple[int, int, int]:
        return colour_at(picture, SIZE[0] / 2 + scale * (metres_x - x), SIZE[1] / 2 - scale * (metres_y - y))

    assert picture.shape == (SIZE[1], SIZE[0], 3)
    assert at(x - 1.5, y) == as_bytes(CAV_COLOURS[0])  # its tail; the front has an arrow
    assert at(x - 8, y) == as_bytes(LIGHT["road"])  # behind its route's start
    assert at(x, y - 20) == as_bytes(LIGHT["ground"])
    assert at(x, 9.5) == as_bytes(LIGHT["footway"][:7]) or np.ptp(np.array(at(x, 9.5))) < 40  # half transparent


def test_the_whole_scene_shows_houses_and_all_cavs(episode: RenderedEpisode) -> None:
    picture = TopViewPainter(episode, SIZE, True, None).paint(0).reshape(-1, 3)
    for colour, least in ((LIGHT["building"], 200), (CAV_COLOURS[0], 20), (CAV_COLOURS[1], 20)):
        assert (picture == as_bytes(colour)).all(-1).sum() > least


def test_the_background_is_painted_once_and_stays(episode: RenderedEpisode) -> None:
    """Ticks in any order give the same picture: nothing of another tick is left over."""
    view = TopViewPainter(episode, SIZE, True, None)
    first = view.paint(5)
    view.paint(30)
    assert np.array_equal(view.paint(5), first)
    assert not np.array_equal(view.paint(6), first)


def count_red(picture: Pixels) -> int:
    return int((picture.reshape(-1, 3) == as_bytes(LIGHT["bad"])).all(-1).sum())


@pytest.mark.parametrize("view", [TopViewPainter, ChaseViewPainter])
def test_an_infraction_is_announced_when_it_happens_and_for_three_seconds(
    view: type[TopViewPainter | ChaseViewPainter],
) -> None:
    view_of = view(make_episode(ticks=160), SIZE, True, 0)
    before, during, after = (count_red(view_of.paint(tick)) for tick in (79, 80, 140))
    assert during > before + 500 > after


def test_behind_a_cav_are_its_rear_and_its_route_below_it(episode: RenderedEpisode) -> None:
    view = ChaseViewPainter(episode, SIZE, True, 0)
    camera = view.paint_world(3)
    picture = view.canvas.to_array()
    x, y, _ = episode.find_pose(0, 3)
    assert (camera.x, camera.y, camera.z) == pytest.approx((x - BEHIND_M, y, ABOVE_M))
    rear = camera.find_pixel((x - 4.7 / 2, y, 0.8))
    assert rear is not None and rear[0] == pytest.approx(320)
    red, green, blue = colour_at(picture, *rear)
    assert blue > green > red, "the colour of the CAV, as bright as the light makes it"
    bare = replace(episode, scenario=episode.scenario.model_copy(update={"egos": episode.scenario.egos[1:]}))
    other = ChaseViewPainter(bare, SIZE, True, 0)
    other.paint_world(3)
    differs = (other.canvas.to_array() != picture).any(-1)
    route = camera.find_pixel((x + 8.0, y, 0.0))
    assert route is not None
    assert not differs[round(rear[1]), 320], "the route does not cover the CAV"
    assert differs[: round(rear[1])].any(), "it is ahead of the CAV"


def test_the_camera_is_before_a_wall_that_would_hide_its_cav(episode: RenderedEpisode) -> None:
    """A wall 10 m behind the CAV: the camera is nearer, and lower by as much as it still looks at the roof."""
    x, y, _ = episode.find_pose(0, 3)
    wall = shapely.box(x - 11.0, y - 5.0, x - 10.0, y + 5.0)
    view = ChaseViewPainter(episode, SIZE, True, 0)
    view._buildings = wall
    camera = view.paint_world(3)
    assert camera.x == pytest.approx(x - 9.5)
    assert (camera.z - AIM_M) / 9.5 == pytest.approx((ABOVE_M - AIM_M) / BEHIND_M)


def test_the_camera_stays_where_its_cav_ended(episode: RenderedEpisode) -> None:
    """CAV 1 leaves the world at 70 % of the episode."""
    last = int(np.flatnonzero(episode.record.valid[:, 1])[-1])
    assert last < 39
    assert episode.find_pose(1, 39) == episode.find_pose(1, last)
    ChaseViewPainter(episode, SIZE, True, 1).paint(39)


def test_areas_that_overlap_are_filled_and_holes_are_not() -> None:
    canvas = Canvas(40, 40)
    canvas.fill_card((0, 0, 40, 40), "#ffffff")
    square = np.array(((5.0, 5.0), (35.0, 5.0), (35.0, 35.0), (5.0, 35.0)))
    hole = np.array(((15.0, 15.0), (15.0, 25.0), (25.0, 25.0), (25.0, 15.0)))
    canvas.fill(Rings.concat([square, hole]), "#102030")
    picture = canvas.to_array()
    assert [colour_at(picture, *place) for place in ((10, 10), (20, 20), (2, 2))] == [
        (16, 32, 48), (255, 255, 255), (255, 255, 255),
    ]  # fmt: skip


def test_any_text_can_be_written() -> None:
    """An agent's name may have the signs of formulas."""
    canvas = Canvas(200, 40)
    canvas.write("$a_b$ {x} \\frac", (5, 30), 14.0, "#000000")
    assert canvas.measure("", 14.0) == 0.0 < canvas.measure("$a$", 14.0) < canvas.measure("$a$b", 14.0)
    assert (canvas.to_array() < 128).any()
    assert choose_text_size(160, 160) == 10.0 < choose_text_size(1280, 720) < choose_text_size(4096, 4096) == 22.0


@pytest.mark.slow
def test_messages_that_arrive_are_lines_for_a_moment(episode: RenderedEpisode) -> None:
    """Only CPMs and MCMs that were delivered, from and to stations of the scenario."""

    def send(name: str, sender: str, **deliveries: tuple[DeliveryStatus, int]) -> SentMessage:
        return SentMessage(Message(name, b"", sender, 9), deliveries)

    got, lost = (DeliveryStatus.DELIVERED, 10), (DeliveryStatus.LOST, 10)
    messages = (
        send("cpm", "cav_0", cav_1=got),
        send("mcm", "cav_1", cav_0=lost),
        send("cam", "cav_1", cav_0=got),
        send("cpm", "stranger", cav_0=got),
    )
    talking = replace(episode, record=replace(episode.record, messages=messages))
    places = [talking.find_pose(column, 12)[:2] for column in (0, 1)]
    assert [(link.type, link.ends.tolist()) for link in talking.list_links(12)] == [("cpm", [list(p) for p in places])]
    assert talking.list_links(9) == talking.list_links(14) == episode.list_links(12) == []
    for painter in (TopViewPainter, ChaseViewPainter):
        shown, hidden, silent = (
            painter(one, SIZE, messages, 0).paint(12)
            for one, messages in ((talking, True), (talking, False), (episode, True))
        )
        assert np.array_equal(hidden, silent)
        assert (painter is ChaseViewPainter) or not np.array_equal(shown, hidden)


def test_the_name_of_the_agent_comes_from_the_recording(episode: RenderedEpisode) -> None:
    assert episode.agent == "idm"
