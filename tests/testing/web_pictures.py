"""Takes the pictures of docs/pages.md: `PYTHONPATH=tests:. python -m testing.web_pictures docs/pages`. No tests.

Everything on them was driven: three teams send the sample agent with different settings.
"""

import io
import json
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

from mdrive_sumo.scenario.suite import load_suite
from server.enums import TokenScope
from server.participant.packaging import write_archive
from server.store import Store, tokens
from testing import web_story
from testing.web_story import Story, Watch

DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
SCENARIOS = tuple(each.id for each in load_suite("interdrive@0").scenarios)[6:13]
TEAMS = (
    ("Blue junction lab", "Steady", "single-agent", {"speed": 6.0}),
    ("Kestrel", "Late brake", "negotiation", {"gap_m": 0.5, "braking": 9.0}),
)


def archive(folder: Path, number: int, changed: dict[str, float]) -> Path:
    """The sample with other settings."""
    target = folder / f"team{number}.zip"
    source = Path(web_story.environments.__file__).parent / "samples" / "agent"
    write_archive(source, target)
    with zipfile.ZipFile(target) as old:
        files = {name: old.read(name) for name in old.namelist()}
    (config,) = [name for name in files if name.startswith("config/")]
    files[config] = json.dumps(json.loads(files[config]) | changed).encode()
    with zipfile.ZipFile(target, "w") as new:
        for name, content in files.items():
            new.writestr(name, content)
    return target


class Camera:
    """Into a folder."""

    def __init__(self, browser: Any, home: str, folder: Path) -> None:
        self._browser, self._home, self._folder = browser, home, folder

    def take(self, name: str, path: str, token: str = "", dark: bool = False, phone: bool = False) -> None:
        """One picture."""
        size = PHONE if phone else DESK
        context = self._browser.new_context(viewport=size, color_scheme="dark" if dark else "light")
        if token:
            context.add_cookies([{"name": "mdrive_token", "value": token, "url": self._home}])
        tab = context.new_page()
        tab.goto(self._home + path)
        tab.wait_for_timeout(1500)
        self.shot(name, tab)
        context.close()

    def shot(self, name: str, tab: Any, whole: bool = False) -> None:
        """Of a tab as it is; 256 colours are enough for these pages."""
        picture = (
            Image.open(io.BytesIO(tab.screenshot(full_page=whole)))
            .convert("RGB")
            .quantize(256, dither=Image.Dither.NONE)
        )
        picture.save(self._folder / f"{name}.png", optimize=True)


def main(folder: Path) -> None:
    """Takes them all."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        here = Path(scratch)
        here.chmod(0o755)
        with web_story.served(here, SCENARIOS) as home, web_story.chromium(playwright) as browser:
            _all(Camera(browser, home, folder), browser, home, here)


def _all(camera: Camera, browser: Any, home: str, here: Path) -> None:
    store = Store(f"sqlite:///{here / 'data' / 'challenge.sqlite'}")
    with store.write() as session:
        admin = tokens.issue(session, None, TokenScope.ADMIN, 1)
    store.close()
    for number, (team, method, track, changed) in enumerate(TEAMS):
        context = browser.new_context(viewport=DESK)
        tab = context.new_page()
        web_story.register(tab, home, team)
        tab.goto(f"{home}/submit")
        tab.check(f"#track-{track}")
        tab.fill("#name", method)
        tab.set_input_files("#archive", archive(here, number, changed))
        if not number:
            camera.shot("submit", tab)
        tab.click("#send")
        tab.wait_for_url(f"{home}/submissions/*")
        if number:
            tab.wait_for_selector("#scenarios .tag:is(.good, .warn)", timeout=120_000)
            camera.shot("submission-running", tab)
            camera.take("admin", "/admin", admin)
        web_story.watch(tab, Story())
        camera.shot("submission", tab, whole=True)
        context.close()
    context = browser.new_context(viewport=DESK)
    story = web_story.told(context, Watch(home), web_story.sample(here))
    context.close()
    mine = story.submission
    camera.take("leaderboard", "/", story.token)
    camera.take("leaderboard-phone", "/", story.token, dark=True, phone=True)
    camera.take("submission-phone", mine, story.token, phone=True)
    camera.take("replay", f"{mine}/scenarios/{SCENARIOS[0]}/0#t=4.00", story.token)
    camera.take("replay-phone", f"{mine}/scenarios/{SCENARIOS[0]}/0/replay#t=4.00", story.token, phone=True)
    camera.take("admin-machine", "/admin/machine", admin, dark=True)
    camera.take("admin-teams", "/admin/teams", admin)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
