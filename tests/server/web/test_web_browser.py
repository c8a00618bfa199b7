"""The pages in a real browser, over a real server: a team registers, submits, watches, looks at the replay, is ranked.

Then every page: nothing fetched elsewhere, nothing wider than a phone, legible in light and dark, every control named.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import expect
from testing import web_story
from testing.archive_samples import packed
from testing.chromium import CHROMIUM, COVERED
from testing.evaluation_real import wait_for
from testing.paths import TESTS
from testing.sandbox_runs import needs_bubblewrap
from testing.web_story import Story, Watch

from server.enums import TokenScope
from server.store import Store, teams, tokens

pytestmark = [
    pytest.mark.slow,
    pytest.mark.costly_fixture,
    pytest.mark.timeout(1200),
    needs_bubblewrap,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium"),
]
DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
SENT = """() => {
  window.sent = [];
  const note = () => window.sent.push(document.getElementById("sent").value);
  document.querySelector("form.submit").addEventListener("htmx:xhr:progress", note);
}"""
CONTRAST = (TESTS / "testing" / "web_contrast.js").read_text("utf-8")


class World:
    """A server, a browser, and what happened in it."""

    def __init__(self, browser: Any, home: str, folder: Path) -> None:
        self.browser, self.seen, self.folder = browser, Watch(home), folder
        context = browser.new_context(viewport=DESK)
        self.archive = web_story.sample(folder)
        self.story: Story = web_story.told(context, self.seen, self.archive)
        context.close()
        store = Store(f"sqlite:///{folder / 'data' / 'challenge.sqlite'}")
        with store.write() as session:
            self.admin = tokens.issue(session, None, TokenScope.ADMIN, 1)
            team = teams.get(session, "The red team")
            self.team, self.token_id = team.id, tokens.list_tokens(session, team)[0].id
        store.close()

    def tab(self, token: str = "", **options: Any) -> Any:
        """A new window, logged in with a token, which is watched."""
        context = self.browser.new_context(**{"viewport": DESK} | options)
        if token:
            context.add_cookies([{"name": "mdrive_token", "value": token, "url": self.seen.home}])
        return self.seen.over(context)

    def pages(self) -> list[tuple[str, str]]:
        """Every page and who may see it."""
        mine = self.story.submission
        one = f"{mine}/scenarios/{web_story.SCENARIOS[0]}/0"
        token = f"/teams/{self.team}/tokens/{self.token_id}/revoke"
        team = ("/", f"/teams/{self.team}", "/how", "/login", "/register", "/submit", mine, one, "/nowhere")
        more = ("/?phase=warm-up&track=joint", "/search?q=red", f"{mine}/compare", token)
        admins = ("/admin", "/admin/machine", "/admin/teams", "/admin/matrix", mine)
        return [(path, self.story.token) for path in (*team, *more)] + [(path, self.admin) for path in admins]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Chromium")
    folder = tmp_path_factory.mktemp("challenge")
    with (
        web_story.served(folder) as home,
        playwright.sync_playwright() as started,
        web_story.chromium(started) as browser,
    ):
        yield World(browser, home, folder)


def test_a_team_registers_submits_by_keyboard_watches_it_finish_and_is_ranked(world: World) -> None:
    story = world.story
    assert story.states[0] in ("queued", "running") and story.states[-1] == "done"
    assert story.driven and all(text.endswith(" of 2 scenarios finished") for text in story.driven)
    assert story.said[-1] == "this submission is done"
    assert 0 < float(story.ds) <= 100
    assert story.painted > web_story.DRAWN  # a blank canvas has one colour
    assert story.row.startswith(f"1 The red team {story.ds} Sample ")  # no interval over so few scenarios
    assert world.seen.trouble == []
    assert world.seen.strangers == []


def test_a_refusal_stands_beside_the_form_with_its_file_still_chosen(world: World, tmp_path: Path) -> None:
    tab = world.tab(world.story.token)
    tab.goto(f"{world.seen.home}/submit")
    bad = tmp_path / "bad.zip"
    bad.write_bytes(b"no zip" * 1_000_000)
    tab.set_input_files("#archive", bad)
    tab.evaluate(SENT)
    tab.fill("#name", "Other")
    tab.check("#track-joint")
    tab.click("#send")
    tab.wait_for_selector("#refusal .problem")
    assert "archive: " in tab.inner_text("#refusal")
    assert tab.input_value("#name") == "Other" and tab.is_checked("#track-joint")
    assert tab.evaluate("document.getElementById('archive').files[0].name") == "bad.zip"
    assert tab.is_hidden("#sending") and tab.is_enabled("#send")
    sent = tab.evaluate("window.sent")
    assert sent == sorted(sent) and sent[-1] == 100
    tab.evaluate("document.getElementById('archive').dataset.most = 10")
    tab.set_input_files("#archive", world.archive)
    said = tab.evaluate("document.getElementById('archive').validationMessage")
    assert said == f"expected at most 10 bytes, found {world.archive.stat().st_size}"
    tab.context.close()
    # Chromium itself notes that an answer was 422; nothing else may have gone wrong.
    assert [text for text in world.seen.trouble if "status of 422" not in text] == []
    world.seen.trouble.clear()


def test_an_agent_with_an_unknown_camera_is_refused_at_upload_and_costs_no_quota(world: World, tmp_path: Path) -> None:
    """The server starts it in a box before it is in the queue."""
    source = "from mdrive_sumo.contract import SensorSpec\nclass Agent:\n    label = 'single'\n"
    source += "    def __init__(self, config): ...\n    def sensors(self): return (SensorSpec('rgb'),)\n"
    archive = tmp_path / "camera.zip"
    archive.write_bytes(packed({"agents.py": source.encode(), "model_env.yaml": b"environment: python3.11-numpy\n"}))
    tab = world.tab(world.story.token)
    tab.goto(f"{world.seen.home}/submit")
    used = tab.inner_text("main table tbody tr")
    tab.fill("#name", "With eyes")
    tab.set_input_files("#archive", archive)
    tab.click("#send")
    tab.wait_for_selector("#refusal .problem")
    assert "sensor 'rgb': expected the sensor \"camera\"" in tab.inner_text("#refusal")
    tab.reload()
    assert tab.inner_text("main table tbody tr") == used
    tab.context.close()
    world.seen.trouble.clear()


@pytest.mark.parametrize("size", [{"width": 1440, "height": 900}, PHONE])
def test_a_replay_opens_at_the_time_of_its_link_and_hides_no_cav(world: World, size: dict[str, int]) -> None:
    tab = world.tab(viewport=size)
    tab.goto(f"{world.seen.home}{world.story.submission}/scenarios/{web_story.SCENARIOS[0]}/0#t=2.00")
    frame = tab.wait_for_selector("iframe.replay").content_frame()
    wait_for(lambda: frame.evaluate("window.viewer?.tick") == 40)
    assert frame.evaluate(COVERED) == []
    assert frame.evaluate("document.getElementById('events').getBoundingClientRect().top < innerHeight - 100")
    ds = tab.inner_text(".figures b >> nth=0")
    assert frame.inner_text("#scores").split()[:3] == ["DS", ds, "%"]
    tab.evaluate("location.hash = '#t=3.00'")
    wait_for(lambda: frame.evaluate("window.viewer?.tick") == 60)
    tab.context.close()
    assert world.seen.trouble == []


def test_the_form_works_without_scripts(world: World) -> None:
    tab = world.tab(world.story.token, java_script_enabled=False)
    tab.goto(f"{world.seen.home}/submit")
    tab.set_input_files("#archive", world.archive)
    tab.fill("#name", "The same again")
    tab.check("#track-joint")
    tab.click("#send")
    assert "track joint: expected one agent for all CAVs" in tab.inner_text("#refusal")
    tab.set_input_files("#archive", world.archive)
    tab.check("#track-negotiation")
    tab.click("#send")  # the same archive in the same track: answered with the finished result
    assert tab.url == world.seen.home + world.story.submission
    tab.context.close()
    world.seen.trouble.clear()


def test_a_replay_that_has_no_room_at_first_is_drawn_as_soon_as_it_has(world: World) -> None:
    """As in a frame of a page that is not laid out yet, which is what phones show."""
    tab = world.tab()
    tab.goto(f"{world.seen.home}{world.story.submission}")
    tab.evaluate(
        """(path) => {
          const frame = document.createElement("iframe");
          Object.assign(frame, { src: path, hidden: true, id: "late", width: 360, height: 640 });
          document.querySelector("main").prepend(frame);
        }""",
        f"{world.story.submission}/scenarios/{web_story.SCENARIOS[0]}/0/replay",
    )
    frame = tab.wait_for_selector("#late", state="attached").content_frame()
    frame.wait_for_load_state()
    tab.wait_for_timeout(500)
    tab.evaluate("document.getElementById('late').hidden = false")
    wait_for(lambda: frame.evaluate("window.viewer !== undefined"))  # waiting in the page is forbidden by its policy
    wait_for(lambda: web_story.colours(frame) > web_story.DRAWN)
    tab.context.close()
    assert world.seen.trouble == []


def test_scenarios_are_filtered_in_place(world: World) -> None:
    tab = world.tab()
    tab.goto(world.seen.home + world.story.submission)
    tab.evaluate("window.notReloaded = true")
    assert tab.locator("#scenarios tbody tr").count() == 2
    tab.click("#scenarios thead >> text=DS")
    tab.wait_for_selector("#scenarios th[aria-sort=ascending] >> text=DS")
    assert "sort=ds" in tab.url and tab.evaluate("window.notReloaded")
    tab.context.close()


def test_a_token_is_made_and_revoked_after_a_question(world: World) -> None:
    tab = world.tab(world.story.token)
    page = f"{world.seen.home}/teams/{world.team}"
    tab.goto(page)
    tab.click("text=New token")
    expect(tab.locator("#issued")).to_have_value(re.compile("^mdrive_"))
    tab.click("main >> text=Back")
    tab.click("#tokens ~ div tbody tr:last-child >> text=Revoke")
    expect(tab.locator("h1")).to_have_text("Revoke this token?")
    tab.click("text=Keep it")
    expect(tab.locator("#tokens ~ div tbody .good")).to_have_count(2)
    tab.click("#tokens ~ div tbody tr:last-child >> text=Revoke")
    tab.click("main form button")
    expect(tab.locator("#tokens ~ div tbody .good")).to_have_count(1)
    tab.context.close()
    assert world.seen.trouble == []


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.full)])
def test_every_page_is_legible_named_and_no_wider_than_a_phone(world: World, scheme: str) -> None:
    world.seen.trouble.clear()
    found: list[str] = []
    holders = {token for _, token in world.pages()}
    tabs = {token: world.tab(token, color_scheme=scheme, viewport=PHONE) for token in holders}
    for path, token in world.pages():
        tab = tabs[token]
        tab.goto(world.seen.home + path)
        wide = tab.evaluate("document.documentElement.scrollWidth")
        found += [f"{path}: {wide} px wide"] if wide > PHONE["width"] else []
        tab.evaluate("for (const each of document.querySelectorAll('details')) each.open = true")
        pale = tab.evaluate(CONTRAST)
        assert pale["looked"] > 5
        found += [f"{path}: {each}" for each in pale["below"]]
        found += [f"{path}: without a name: {each}" for each in nameless(tab)]
    for tab in tabs.values():
        tab.context.close()
    assert found == []
    assert [text for text in world.seen.trouble if "status of 404" not in text] == []
    assert world.seen.strangers == []


def nameless(tab: Any) -> list[str]:
    """What can have the focus but has no name for a screen reader, as Chromium's own accessibility tree says."""
    session = tab.context.new_cdp_session(tab)
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    bad: list[str] = []
    for node in nodes:
        focusable = any(each["name"] == "focusable" and each["value"]["value"] for each in node.get("properties", ()))
        role = node.get("role", {}).get("value", "")
        if focusable and not node["ignored"] and role not in ("RootWebArea", "main", "generic"):
            name = node.get("name", {}).get("value", "").strip()
            bad += [] if name else [role]
    named = ":is([aria-label], [aria-labelledby], pre)"  # text that scrolls is its own name
    return bad + tab.evaluate(f"[...document.querySelectorAll('[tabindex=\"0\"]:not({named})')].map((e) => e.tagName)")
