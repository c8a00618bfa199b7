"""A visitor of the pages: a browser's cookies and headers, without the browser; and what must hold on every page."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import Any

from httpx import Response

from server.api.leaderboard_cache import STALE_US
from server.enums import ScenarioVerdict
from server.store import jobs, submissions
from server.store.jobs import JobOutcome
from server.web.templating import POLICY
from server.web.visitor import COOKIE
from testing.api_app import Server, another_zip
from testing.api_client import Client
from testing.store_samples import LEASE, S

VOID = frozenset(("area", "br", "col", "hr", "img", "input", "link", "meta", "wbr"))
CLOSED_BY_THEMSELVES = frozenset(("circle", "line", "path", "polygon", "polyline", "rect", "use"))
"""In SVG."""


class Element:
    """Of a parsed page."""

    def __init__(self, tag: str, attributes: Mapping[str, str]) -> None:
        self.tag, self.attributes = tag, attributes
        self.text = ""
        """With that of everything in it."""


class Page(HTMLParser):
    """A parsed page. Raises AssertionError where tags do not match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[Element] = []
        self._open: list[Element] = []
        self.feed(text)
        self.close()
        assert not self._open, f"not closed: {self._open[-1].tag}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(set(names)) == len(names), f"an attribute twice: {tag} {names}"
        element = Element(tag, {name: value or "" for name, value in attrs})
        self.elements.append(element)
        if tag not in VOID:
            self._open.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in VOID | CLOSED_BY_THEMSELVES, f"<{tag}/> is not closed in HTML"
        self.elements.append(Element(tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self._open and self._open[-1].tag == tag, f"</{tag}> closes {self._open[-1].tag if self._open else None}"
        self._open.pop()

    def handle_data(self, data: str) -> None:
        for element in self._open:
            element.text += data

    def all(self, tag: str, **attributes: str) -> list[Element]:
        """Of a tag with these attributes (`class_` has that class among its own)."""
        class_ = attributes.pop("class_", None)
        return [
            each
            for each in self.elements
            if each.tag == tag
            and all(each.attributes.get(name.replace("_", "-")) == value for name, value in attributes.items())
            and (class_ is None or class_ in each.attributes.get("class", "").split())
        ]

    @property
    def words(self) -> str:
        """What is in it to be read, spaces made one."""
        return " ".join(self.all("main")[0].text.split())


def sound(answer: Response) -> Page:
    """A page that is as every page must be."""
    assert answer.headers["content-type"] == "text/html; charset=utf-8", answer.text[:200]
    assert answer.headers["content-security-policy"] == POLICY
    page = Page(answer.text)
    assert answer.text.lower().startswith("<!doctype html>") and page.all("html", lang="en") and page.all("title")
    ids = [each.attributes["id"] for each in page.elements if "id" in each.attributes]
    assert len(set(ids)) == len(ids), sorted(each for each in ids if ids.count(each) > 1)
    assert len(page.all("h1")) == 1 and len(page.all("main")) == 1
    for element in page.elements:
        _safe(element)
        for name in ("aria-labelledby", "aria-describedby", "for"):
            for wanted in element.attributes.get(name, "").split():
                assert wanted in ids, f"{name}={wanted}"
    _labelled(page)
    return page


def _safe(element: Element) -> None:
    """Nothing that the policy forbids, and no other host."""
    names = element.attributes
    assert element.tag not in ("style", "base", "object", "embed")
    assert "style" not in names and not any(name.startswith(("on", "hx-on")) for name in names), names
    if element.tag == "script":
        assert names.get("src", "").startswith("/static/"), names
    for name in ("href", "src", "action", "hx-get", "hx-post"):
        if name in names:
            assert names[name].startswith(("/", "#", "?")) and not names[name].startswith("//"), names[name]


def _labelled(page: Page) -> None:
    labels = {each.attributes.get("for") for each in page.all("label")}
    for tag in ("input", "select", "textarea"):
        for each in page.all(tag):
            named = each.attributes.get("id") in labels or "aria-label" in each.attributes
            assert named or each.attributes.get("type") == "hidden", each.attributes
    for tag in ("a", "button", "th"):
        for each in page.all(tag):
            assert each.text.strip() or "aria-label" in each.attributes, (tag, each.attributes)
    for table in page.all("table"):
        assert table.text.strip()
    assert len(page.all("caption")) == len(page.all("table"))
    assert all(each.attributes.get("scope") for each in page.all("th"))
    assert all("aria-hidden" in each.attributes or each.attributes.get("role") == "img" for each in page.all("svg"))
    assert all(each.attributes.get("title") for each in page.all("iframe"))


@dataclass
class Visit:
    """Somebody's browser."""

    server: Server
    who: str = ""
    """Whose token is in its cookie; "" for nobody's."""
    client: Any = field(init=False)

    def __post_init__(self) -> None:
        self.server.mount_pages()
        self.client = Client(self.server.app, follow_redirects=False)
        if self.who:
            self.client.cookies.set(COOKIE, self.server.tokens[self.who])

    def get(self, path: str, status: int = 200) -> Page:
        """A page, checked as every page is."""
        answer = self.client.get(path)
        assert answer.status_code == status, answer.text
        return sound(answer)

    def post(self, path: str, status: int = 303, **fields: str) -> Response:
        """A form sent, as by a page of this server."""
        answer = self.client.post(path, data=fields, headers={"Sec-Fetch-Site": "same-origin"})
        assert answer.status_code == status, answer.text
        return answer


def without_ids(text: str) -> list[str]:
    """What can have the focus but not keep it where HTMX swaps it: it finds it again by its id."""
    tags = re.findall(r"<(?:a|button|summary|div)\b[^>]*>", text)
    return [tag for tag in tags if (not tag.startswith("<div") or "tabindex" in tag) and " id=" not in tag]


PAPER = ("CoDriving", "CoLMDriver", "TCP", "CoLMDriver (rule-based)", "LMDrive", "UniAD", "VAD")
"""Methods of the paper."""


def driven(server: Server, who: str, ds: float, sensing: str = "object", **fields: str) -> str:
    """A finished submission, on the boards now."""
    server.now_us += S
    answer = server.send(who, another_zip(server.now_us // S), **fields)
    assert answer.status_code == 201, answer.text
    mine = answer.json()["id"]
    figures: Any = {"ds": ds, "sr": 100 - ds, "rc": ds, "ip": 0.5, "ds_low": ds - 5, "ds_high": ds + 5, "scenarios": 12}
    figures |= {"efficient_sr": (100 - ds) / 2, "time_ratio": 1 + ds / 50, "timed": 7}
    figures |= {
        "scalars": {
            "mean_speed": ds / 10,
            "comfort": 99.0,
            "min_ttc": None,
            "min_pet": 1.2,
            "message_rate": ds,
            "speeding": 2.0,
        }
    }
    parts = {"overall": figures, "buckets": {"InterDrive": figures | {"ds": 99 - ds}}, "categories": {"merge": figures}}
    parts |= {"sensing_track": sensing, "results_sha256": "0" * 64}
    with server.store.write() as session:
        while (job := jobs.claim(session, "worker", LEASE, server.now_us)) is not None:
            outcome = JobOutcome(ScenarioVerdict.OK, {"ds": ds, "sr": 0.0})
            assert jobs.finish(session, job.id, "worker", job.attempt, outcome, server.now_us)
        assert submissions.finish_if_complete(session, mine, parts, server.now_us)
    server.now_us += STALE_US
    return mine


def first_table(page: Page) -> list[str]:
    """Row headers of the leaderboard: the teams."""
    headers = [each.text for each in page.all("th", scope="row", class_="words")]
    return [text for text in headers if text not in PAPER]


def links(page: Page, start: str = "") -> list[str]:
    """Where links of a page lead to that begin so."""
    return [each.attributes["href"] for each in page.all("a") if each.attributes["href"].startswith(start)]
