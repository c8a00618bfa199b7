"""The layers of the replay: what the page carries for them, and what they show in a browser."""

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from testing.viewer_crossing import crossing, record, scenario, some_marks
from testing.viewer_talking import RSU, talking, with_rsu

from mdrive_sumo.contract import Message
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.replay_data import compute_visibility
from mdrive_sumo.report.replay_messages import describe_event
from mdrive_sumo.report.replay_page import render_replay
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage
from mdrive_sumo.v2x.messages import (
    Cam,
    Cpm,
    Denm,
    EventCause,
    Mcm,
    ReferencePose,
    Termination,
    decode,
    encode,
)
from mdrive_sumo.v2x.radio.path_loss import LinkClass
from mdrive_sumo.v2x.radio.radio_medium import AirLink
from tests.mdrive_sumo.report.test_replay_page import HOSTILE, SETTLED, carried, needs_browser, opened, wait

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]

LAYERS = ("sight", "intentions", "messages", "links", "shared", "transcript")


@pytest.fixture(scope="module")
def talk() -> EpisodeRecord:
    return talking(ticks=120, egos=4, actors=20)


def page_of(episode: EpisodeRecord, egos: int = 4) -> str:
    return render_replay(episode, with_rsu(egos), crossing(), some_marks(episode.ticks))


# ---- what the page carries


def test_every_message_and_every_fate_is_carried(talk: EpisodeRecord) -> None:
    header, tables = carried(page_of(talk))
    said, names = header["talk"], header["talk"]["stations"]
    assert names == [*talk.ego_ids, RSU]
    heads = {(said["types"][t], names[s], tick, size) for t, s, tick, size in tables["messages"].T.tolist()}
    assert heads == {(m.type, m.sender, m.tick, len(m.payload)) for m in (one.message for one in talk.messages)}
    fates = [(names[to], said["fates"][fate], tick) for _, to, fate, tick in tables["fates"].T.tolist()]
    truth = [(to, str(fate), tick) for one in talk.messages for to, (fate, tick) in one.deliveries.items()]
    assert sorted(fates) == sorted(truth)


def test_contents_are_those_that_were_decoded(talk: EpisodeRecord) -> None:
    header, tables = carried(page_of(talk))
    names, types = header["talk"]["stations"], header["talk"]["types"]
    truth = {(m.type, m.sender, m.tick): decode(m) for m in (one.message for one in talk.messages)}
    content = [truth[types[t], names[s], tick] for t, s, tick, _ in tables["messages"].T.tolist()]
    for row, x, y, yaw, speed, *_ in tables["cams"].T.tolist():
        cam = content[row]
        assert isinstance(cam, Cam)
        told = x / 100 + header["origin"][0], y / 100 + header["origin"][1], yaw / 1e4, speed / 100
        assert told == pytest.approx((cam.pose.x, cam.pose.y, cam.pose.yaw, cam.speed), abs=0.006)
    first = tables["cpm_objects"][:, 0]
    cpm = content[first[0]]
    assert isinstance(cpm, Cpm)
    i = cpm.objects.ids.index(header["talk"]["tracks"][first[1]])
    assert first[3] / 100 + header["origin"][0] == pytest.approx(cpm.objects.x[i], abs=0.006)
    mcm_row = tables["mcms"][:, 0]
    mcm = content[mcm_row[0]]
    assert isinstance(mcm, Mcm)
    drawn = tables["mcm_points"][:, mcm_row[7] - 1] / 100 + header["origin"]
    assert drawn == pytest.approx(mcm.planned[-1], abs=0.006)  # the last point is never thinned out


def test_unreadable_and_foreign_messages_are_only_named() -> None:
    said = (Message("cam", b"?", "cav_0", 3), Message("own-type", b"\x00\x01", "cav_1", 4))
    fates = {"cav_1": (DeliveryStatus.MALFORMED, 3)}, {"cav_0": (DeliveryStatus.DELIVERED, 5)}
    sent = tuple(SentMessage(message, fate) for message, fate in zip(said, fates, strict=True))
    header, tables = carried(page_of(replace(record(), messages=sent), egos=2))
    assert header["talk"]["types"] == ["cam", "own-type"]
    assert header["talk"]["problems"] == [[0, "expected at least 18 bytes, found 1"]]
    assert tables["messages"][2:].T.tolist() == [[3, 1], [4, 2]]
    assert tables["cams"].size == 0 and header["talk"]["texts"] == []


def test_a_warning_is_told_in_words() -> None:
    pose = ReferencePose(10.0, 5.0, 0.0, 3)
    denm = Denm(pose, 2, EventCause.DANGEROUS_SITUATION, 1, 12.26, 5.0, 3, 1.0, 4.0, 4.9, 2.0)
    said = (replace(encode(denm), sender="cav_0", tick=3),)
    sent = tuple(SentMessage(message, {"cav_1": (DeliveryStatus.DELIVERED, 5)}) for message in said)
    header, _ = carried(page_of(replace(record(), messages=sent), egos=2))
    assert header["talk"]["texts"] == [[0, "event 2, dangerous situation, at (12.3, 5.0), valid for 1 s"]]
    assert describe_event(replace(denm, termination=Termination.CANCELLATION)).endswith(", cancelled")


def test_what_a_cav_sees() -> None:
    """cav_0 drives east, the building hides from it what comes from behind; no CAV sees itself."""
    episode = record(actors=30)
    sight = compute_visibility(episode, crossing())
    assert sight.shape == (2, 32, 10)
    assert not sight[0, 0].any() and not sight[1, 1].any()
    away = np.hypot(episode.x[::4] - episode.x[::4, :1], episode.y[::4] - episode.y[::4, :1]).T
    assert not sight[0][away > 110].any()
    seen = sight[0][(away < 90) & episode.valid[::4].T]
    assert 0 < seen.mean() < 1
    assert not sight[1, :, 8:].any()  # its agent failed in tick 28: there it sees nothing any more


def test_notes_are_told_with_what_was_asked(talk: EpisodeRecord) -> None:
    notes = carried(page_of(talk))[0]["notes"]
    assert notes[0] == [5, "cav_0", "llm-exchange", "I wait for you.", "Speak: I wait for you."]
    assert notes[1] == [12, "cav_1", "llm-fallback", "I wait for you.", ""]
    assert notes[2][3] == "round: 1\nfeedback: I wait for you."


@pytest.mark.full
def test_a_talkative_minute_stays_small() -> None:
    """Four CAVs among 100 others for a minute, CAM at 20 Hz, CPM and MCM at 10 Hz, as restless as measured objects."""
    episode = talking(ticks=1200, egos=4, actors=100)
    assert len(page_of(episode)) < 1_500_000


# ---- in a browser


@pytest.fixture(scope="module")
def talk_file(tmp_path_factory: pytest.TempPathFactory, talk: EpisodeRecord) -> Path:
    path = tmp_path_factory.mktemp("layers") / "talk.html"
    path.write_text(page_of(talk), encoding="utf-8")
    return path


@pytest.fixture
def page(browser: Any, talk_file: Path) -> Iterator[Any]:
    yield from opened(browser, talk_file.as_uri())


@needs_browser
def test_keys_and_buttons_switch_layers(page: Any) -> None:
    assert page.evaluate("viewer.layers") == ["intentions"]
    for key in "vimrot":
        page.keyboard.press(key)
    assert page.evaluate("viewer.layers.sort()") == ["links", "messages", "shared", "sight", "transcript"]
    page.click("#layer-intentions")
    assert "intentions" in page.evaluate("viewer.layers")
    wait(page, "document.querySelectorAll('#layers [aria-pressed=true]').length === 6")


@needs_browser
def test_every_layer_is_seen(page: Any) -> None:
    page.evaluate("viewer.seek(102)")  # two ticks after cav_0 said something
    page.keyboard.press("i")
    wait(page, SETTLED)
    plain = picture(page)
    for key in "vimrot":
        page.keyboard.press(key)
        wait_until(lambda: picture(page) != plain, f"{key} shows nothing")
        page.keyboard.press(key)
        wait_until(lambda: picture(page) == plain, f"{key} leaves something")


def picture(page: Any) -> bytes:
    """The middle of the map."""
    return page.screenshot(clip={"x": 300, "y": 100, "width": 560, "height": 260})


def wait_until(truth: Callable[[], bool], otherwise: str) -> None:
    end = time.monotonic() + 60.0
    while not truth():
        assert time.monotonic() < end, otherwise


@needs_browser
def test_no_label_covers_another_one(page: Any) -> None:
    page.evaluate("viewer.seek(60)")
    counts: dict[str, int] = {}
    for _ in range(3):
        page.wait_for_timeout(120)
        mode, rects = page.evaluate("[viewer.labels.mode, viewer.labels.rects]")
        counts[mode] = len(rects)
        boxes = np.array([shapely.box(*rect) for rect in rects], dtype=object)
        one, other = shapely.STRtree(boxes).query(boxes, predicate="intersects")
        assert not (shapely.area(shapely.intersection(boxes[one], boxes[other]))[one != other] > 0.5).any(), mode
        page.keyboard.press("l")
    assert 4 <= counts["none"] <= counts["near"] <= counts["all"]  # events and intentions keep their names
    assert counts["all"] > 12


@needs_browser
def test_a_layer_without_anything_to_show_says_why(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "silent.html"
    path.write_text(render_replay(record(), scenario(2), crossing(), ()), encoding="utf-8")
    for tab in opened(browser, path.as_uri()):
        for key in "imrot":
            tab.keyboard.press(key)
        assert tab.evaluate("viewer.layers") == []
        for layer in LAYERS[1:]:
            assert tab.is_disabled(f"#layer-{layer}")
            assert "in this recording" in tab.get_attribute(f"#layer-{layer}", "title")
        assert tab.is_enabled("#layer-sight")


@needs_browser
def test_messages_of_the_selected_cav_are_listed_with_their_fates(page: Any) -> None:
    page.keyboard.press("m")
    page.evaluate("viewer.seek(44)")
    wait(page, "document.querySelectorAll('#messages li:not([hidden])').length > 8")
    rows = [row.split("\n") for row in page.locator("#messages li:not([hidden])").all_inner_texts()]
    ways = {(cells[1].lower(), cells[2]) for cells in rows}
    assert ("cpm", "→ sent") in ways and ("mcm", "← cav_2") in ways and ("cpm", f"← {RSU}") in ways
    assert not any(kind == "cam" for kind, _ in ways)  # 20 a second: only on demand
    page.click("#filters .cam")
    wait(page, "document.getElementById('messages').innerText.toLowerCase().includes('cam')")
    fates = {cells[4] for cells in rows if cells[2] != "→ sent"}
    assert fates == {"100 ms", "lost"}


@needs_browser
def test_links_say_what_was_received_within_a_second(page: Any, talk: EpisodeRecord) -> None:
    """Of all types, by the tick of sending; every seventh message is lost."""
    links = page.evaluate("viewer.talk.linksAt(60)")
    stations = [*talk.ego_ids, RSU]
    assert {(one["from"], one["to"]) for one in links} == {(a, b) for a in range(5) for b in range(4) if a != b}
    for one in links:
        fates = [
            sent.deliveries[stations[one["to"]]]
            for sent in talk.messages
            if sent.message.sender == stations[one["from"]] and 40 < sent.message.tick <= 60
        ]
        share = sum(status is DeliveryStatus.DELIVERED for status, _ in fates) / len(fates)
        assert one["share"] == pytest.approx(share) and one["name"] == ""
    assert not page.is_visible("#link-classes")


@needs_browser
def test_links_of_a_radio_have_a_class(browser: Any, tmp_path: Path) -> None:
    episode, path = talking(), tmp_path / "radio.html"
    houses = {name: AirLink(LinkClass.NLOSB, -80) for name in episode.ego_ids}
    messages = tuple(replace(sent, links=houses) for sent in episode.messages)
    path.write_text(page_of(replace(episode, messages=messages), egos=2), encoding="utf-8")
    for tab in opened(browser, path.as_uri()):
        tab.keyboard.press("r")
        wait(tab, "viewer.layers.includes('links')")
        assert {one["name"] for one in tab.evaluate("viewer.talk.linksAt(30)")} == {"NLOSb"}
        assert tab.is_visible("#link-classes")


@needs_browser
def test_an_agreed_order_is_numbered(page: Any, talk: EpisodeRecord) -> None:
    """cav_0 accepts its own request, so its group is an order: the other way round."""
    last = len(talk.ego_ids) - 1
    assert page.evaluate("[...viewer.talk.ranksAt(100)]") == [[last - i, i + 1] for i in range(last + 1)]
    assert len(page.evaluate("viewer.talk.groupsAt(100)")) == 1
    lines = page.evaluate("viewer.talk.agreements(0).map((entry) => entry.text)")
    assert any(line.endswith("order of passing: cav_3, cav_2, cav_1, cav_0") for line in lines)


@needs_browser
def test_a_message_opens(page: Any) -> None:
    page.keyboard.press("m")
    page.evaluate("viewer.seek(119)")
    for kind, words in {"cpm": "40.0 m", "mcm": "intention", "text": "I wait for you."}.items():
        for other in ("cpm", "mcm", "text"):
            wanted = str(other == kind).lower()
            if page.get_attribute(f"#filters .{other}", "aria-pressed") != wanted:
                page.click(f"#filters .{other}")
        wait(page, f"document.querySelector('#messages .chip').className === 'chip {kind}'")
        page.click("#messages li >> nth=0")
        assert f"{kind.upper()} from " in page.inner_text("#detail-title")
        assert words in page.inner_text("#detail-facts")
    page.click("#detail-close")
    assert not page.is_visible("#detail")


@needs_browser
def test_shared_objects_are_those_received_within_a_second(page: Any) -> None:
    senders = "viewer.talk.received(0, {}).map((message) => message.from)"
    assert page.evaluate(senders.format(1)) == []  # the first ones are still on their way
    assert page.evaluate(senders.format(60)) == [1, 2, 3, 4]
    assert page.evaluate("viewer.talk.received(0, 60).every((m) => m.tick <= 58 && m.tick > 40)")


@needs_browser
def test_what_a_model_said_is_listed_once(browser: Any, tmp_path: Path) -> None:
    path, episode = tmp_path / "model.html", talking()
    first = episode.notes[0]
    path.write_text(page_of(replace(episode, notes=(replace(first, tick=0),)), egos=2), encoding="utf-8")
    for tab in opened(browser, path.as_uri()):
        tab.keyboard.press("t")
        wait(tab, "document.querySelectorAll('.entry:not([hidden])').length === 1")
        tab.click(".entry summary")
        assert "Speak: I wait for you." in tab.inner_text(".entry")


@needs_browser
def test_the_transcript_keeps_step(page: Any) -> None:
    page.keyboard.press("t")
    page.evaluate("viewer.seek(12)")
    wait(page, "document.querySelectorAll('.entry:not([hidden])').length === 5")
    assert "llm-fallback" in page.inner_text(".entry.newest")
    page.evaluate("viewer.seek(119)")
    wait(page, "document.getElementById('transcript').innerText.includes('agrees with cav_0')")
    assert "asks cav_1: stop\norder of passing: cav_3, cav_2, cav_1, cav_0" in page.inner_text("#transcript")
    page.click(".entry >> nth=0")
    assert page.evaluate("viewer.tick") == 0
    wait(page, "document.querySelectorAll('.entry:not([hidden])').length === 1")
    assert "round 1" in page.inner_text(".entry.newest")


@needs_browser
def test_hostile_words_do_nothing(browser: Any, tmp_path: Path) -> None:
    path, episode = tmp_path / "hostile.html", talking(text=HOSTILE)
    page = page_of(episode, egos=2)
    assert "onerror" not in page
    path.write_text(page, encoding="utf-8")
    for tab in opened(browser, path.as_uri()):
        for key in "vmot":
            tab.keyboard.press(key)
        tab.evaluate("viewer.seek(39)")
        wait(tab, f"document.getElementById('transcript').innerText.includes({HOSTILE[:20]!r})")
        assert tab.title() == "crossing-4 · mdrive-sumo"
        assert tab.evaluate("document.images.length") == 0


@needs_browser
def test_a_link_opens_with_its_layers(browser: Any, talk_file: Path) -> None:
    for tab in opened(browser, f"{talk_file.as_uri()}#t=2.00&show=sight,messages"):
        assert tab.evaluate("[viewer.tick, viewer.layers.sort()]") == [40, ["messages", "sight"]]
        tab.keyboard.press("v")
        wait(tab, "location.hash === '#t=2.00&show=messages'")


@pytest.mark.full
@needs_browser
def test_all_layers_draw_fast_enough(browser: Any, tmp_path: Path, record_property: Any) -> None:
    """As without layers; the limit is for machines that are busy."""
    path = tmp_path / "busy.html"
    path.write_text(page_of(talking(ticks=400, egos=4, actors=100)), encoding="utf-8")
    for tab in opened(browser, path.as_uri()):
        for key in ("v", "o", "m", "t", "Space"):
            tab.keyboard.press(key)
        wait(tab, "viewer.drawTimes.length >= 150")
        draws = tab.evaluate("viewer.drawTimes")
        record_property("draw_p50_ms", statistics.median(draws[-120:]))
        assert statistics.median(draws[-120:]) <= 40.0
