"""A challenge as people meet it: a real server, a real browser, a team from its registration to its rank. No tests."""

import json
import subprocess
import sys
import time
from collections.abc import Collection, Generator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mdrive_sumo.scenario.reference_times import find_reference_times, save_reference_times
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite
from server import environments
from server.participant.packaging import write_archive
from testing.chromium import CHROMIUM, list_flags
from testing.processes import wait_for
from testing.short_suite import shorten

SCENARIOS = ("i07_ins_ss_town", "i08_ins_ss_old_town")
ROUTE_M = 40
"""Of each route: some seconds to drive."""
STARTED_S, DRIVEN_S = 90.0, 240.0
DRAWN = 20
"""Colours that a replay's canvas has more of, once it is drawn."""
SETTINGS = """
data = "{data}"

[registration]
open = true

[sandbox]
backend = "bubblewrap"
required = ["namespaces", "read-only", "privileges", "seccomp", "rlimits"]

[work]
processes = 1
spot_check = 0.0

[[phases]]
id = "warm-up"
title = "Warm-up"
suite = "{suite}"
public = true
opens = 2020-01-01T00:00:00Z
closes = 2100-01-01T00:00:00Z
"""


@contextmanager
def served(folder: Path, scenarios: Collection[str] = SCENARIOS) -> Generator[str]:
    """`mdrive-sumo serve` with a phase of these scenarios and one worker; its address."""
    suite, data = folder / "suite", folder / "data"
    packaged = load_suite("interdrive@0")
    chosen = tuple(shorten(each, ROUTE_M) for each in packaged.scenarios if each.id in scenarios)
    save_suite(Suite(SuiteFile(name="few", title="A few scenarios"), suite, chosen))
    times = {each.id: find_reference_times(each, packaged.find_folder(each.id)) for each in chosen}
    save_reference_times(load_suite(str(suite)), times)
    about = data / "environments" / "python3.11-numpy" / environments.ABOUT_FILE
    about.parent.mkdir(parents=True)
    about.write_text(json.dumps(asdict(environments.current_environment()), default=str))
    (folder / "server.toml").write_text(SETTINGS.format(data=data, suite=suite))
    command = [sys.executable, "-c", "from server.cli import serve; serve()", "--port", "0"]
    log = folder / "server.log"
    with log.open("w") as file:
        process = subprocess.Popen(
            [*command, "--settings", str(folder / "server.toml")], stdout=file, stderr=subprocess.STDOUT
        )
    try:
        yield _address(process, log)
    finally:
        process.terminate()
        process.wait(60)


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    deadline_s = time.monotonic() + STARTED_S
    while time.monotonic() < deadline_s and process.poll() is None:
        for word in log.read_text().split():
            if word.startswith("http://127.0.0.1:"):
                return word
        time.sleep(0.05)
    raise AssertionError(log.read_text())


def sample(folder: Path) -> Path:
    """The archive of the sample agent."""
    target = folder / "team.zip"
    write_archive(Path(environments.__file__).parent / "samples" / "agent", target)
    return target


@contextmanager
def chromium(playwright: Any) -> Generator[Any]:
    """A browser."""
    browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list_flags())
    try:
        yield browser
    finally:
        browser.close()


@dataclass
class Watch:
    """What must not happen in any tab."""

    home: str
    trouble: list[str] = field(default_factory=list)
    strangers: list[str] = field(default_factory=list)
    """Requests to other hosts."""

    def over(self, context: Any) -> Any:
        """A new tab that is watched."""
        tab = context.new_page()
        tab.on("console", self._hear)
        tab.on("pageerror", lambda error: self.trouble.append(str(error)))
        tab.on("dialog", lambda dialog: self.trouble.append(dialog.message))
        tab.on("filechooser", lambda _: None)  # from now on: asked for only with the key press it would come too late
        tab.on("request", lambda request: self._look_at(request.url))
        return tab

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.trouble.append(f"{message.type}: {message.text}")

    def _look_at(self, url: str) -> None:
        if not url.startswith((self.home + "/", "data:", "blob:")):
            self.strangers.append(url)


@dataclass
class Story:
    """What happened."""

    token: str = ""
    submission: str = ""
    """Path of its page."""
    states: list[str] = field(default_factory=list)
    """As seen, one after the other, on the page that was never loaded again."""
    driven: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    """To screen readers."""
    ds: str = ""
    painted: int = 0
    """Colours on the replay's canvas."""
    row: str = ""
    """On the leaderboard."""


def register(tab: Any, home: str, name: str) -> str:
    """Makes a team; its token."""
    tab.goto(f"{home}/register")
    tab.fill("#name", name)
    tab.click("main form button")
    token = tab.input_value("#issued")
    tab.click("text=Log out")
    tab.goto(f"{home}/login")
    tab.fill("main form input", token)
    tab.click("main form button")
    tab.wait_for_url(f"{home}/teams/*")
    return token


def submit(tab: Any, home: str, archive: Path, name: str) -> str:
    """Sends the form with the keyboard only; the submission's path."""
    tab.goto(f"{home}/submit")
    tab.evaluate("document.getElementById('main').focus()")
    keys = tab.keyboard
    keys.press("Tab")
    assert focused(tab) == "phase"
    keys.press("Tab")
    assert focused(tab) == "track-single-agent"
    keys.press("ArrowDown")
    keys.press("ArrowDown")
    assert focused(tab) == "track-negotiation"
    keys.press("Tab")
    assert focused(tab) == "name"
    keys.type(name)
    keys.press("Tab")
    assert focused(tab) == "archive"
    with tab.expect_file_chooser() as chooser:
        keys.press("Enter")
    chooser.value.set_files(archive)
    keys.press("Tab")
    assert focused(tab) == "send"
    keys.press("Enter")
    tab.wait_for_url(f"{home}/submissions/*")
    return tab.url.removeprefix(home)


def focused(tab: Any) -> str:
    """Id of the element that has the focus."""
    return tab.evaluate("document.activeElement.id")


def watch(tab: Any, story: Story) -> None:
    """Until it is done, without loading the page again."""
    tab.evaluate("window.notReloaded = true")
    deadline_s = time.monotonic() + DRIVEN_S
    while time.monotonic() < deadline_s:
        state = tab.inner_text("#state")
        label = tab.query_selector("label[for=driven]")
        _noted(story.states, state)
        _noted(story.said, tab.inner_text("#status"))
        if label is not None:
            _noted(story.driven, label.inner_text())
        if state not in ("queued", "running"):
            break
        tab.wait_for_timeout(200)
    tab.wait_for_selector("#ds")
    tab.wait_for_selector("#actions >> text=Hide from the leaderboard")
    assert tab.evaluate("window.notReloaded")
    story.ds = tab.inner_text("#ds")


def _noted(seen: list[str], text: str) -> None:
    if text and (not seen or seen[-1] != text):
        seen.append(text)


def replay(tab: Any, home: str, submission: str) -> int:
    """Opens a replay; how many colours are on its canvas."""
    tab.goto(f"{home}{submission}")
    tab.click("#scenarios >> text=replay >> nth=0")
    frame = tab.wait_for_selector("iframe.replay").content_frame()
    frame.wait_for_selector("canvas", timeout=120_000)
    wait_for(lambda: colours(frame) > DRAWN, 120.0)
    return colours(frame)


def colours(frame: Any) -> int:
    """On the replay's canvas; a blank one has one."""
    return frame.evaluate(
        """() => {
          const canvas = document.querySelector("canvas");
          const copy = document.createElement("canvas");
          Object.assign(copy, { width: canvas.width, height: canvas.height });
          const pen = copy.getContext("2d", { willReadFrequently: true });
          pen.drawImage(canvas, 0, 0);
          const data = pen.getImageData(0, 0, copy.width, copy.height).data;
          return new Set(new Uint32Array(data.buffer)).size;
        }"""
    )


def told(context: Any, seen: Watch, archive: Path) -> Story:
    """The whole of it."""
    story, tab = Story(), seen.over(context)
    story.token = register(tab, seen.home, "The red team")
    story.submission = submit(tab, seen.home, archive, "Sample")
    watch(tab, story)
    story.painted = replay(tab, seen.home, story.submission)

    def row() -> str:
        tab.goto(f"{seen.home}/?phase=warm-up&track=negotiation")
        return " ".join(tab.inner_text("main table tbody tr").split())

    wait_for(lambda: "The red team" in row(), 120.0)  # a board may be handed out while the new one is made
    story.row = row()
    tab.close()
    return story
