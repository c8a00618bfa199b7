"""The form and the pages of submissions: who sees what, what is kept of a refused form, what hidden phases tell."""

from pathlib import Path

import pytest
from httpx import Response
from testing import web_scenes
from testing.api_app import ZIP, Server, another_zip
from testing.store_samples import NOON, S
from testing.web_page import Page, Visit, links, sound, without_ids
from testing.web_scenes import drive, files, finish, sent

from server.store import submissions

pytestmark = pytest.mark.slow

SENT = {"phase": "dev", "track": "negotiation", "name": "My <method>"}
SAME = {"Sec-Fetch-Site": "same-origin"}


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path / "data")


@pytest.fixture
def red(server: Server) -> Visit:
    return Visit(server, "red")


def upload(visit: Visit, data: bytes = ZIP, path: str = "/submit", script: bool = False, **fields: str) -> Response:
    headers = SAME | ({"HX-Request": "true"} if script else {})
    archive = {"archive": ("team.zip", data, "application/zip")}
    return visit.client.post(path, data=SENT | fields, files=archive, headers=headers)


def test_the_form_offers_open_phases_and_says_what_is_used(red: Visit) -> None:
    page = red.get("/submit?phase=test")
    assert [(each.attributes["value"], "selected" in each.attributes) for each in page.all("option")] == [
        ("dev", False),
        ("test", True),
    ]
    assert len(page.all("input", type="radio")) == 4
    assert "at most 64 KiB" in page.words and "Past" not in page.words
    assert "Development0 of 30 of 20 of 100" in page.words
    upload(red)
    assert "Development1 of 31 of 21 of 100" in red.get("/submit").words


def test_only_teams_can_submit(server: Server) -> None:
    Visit(server).get("/submit", 401)
    Visit(server, "admin").get("/submit", 403)


def test_an_upload_leads_to_its_page_and_is_what_the_api_would_have_made(server: Server, red: Visit) -> None:
    answer = upload(red, name="Mine")
    assert answer.status_code == 303
    made = server.get(answer.headers["location"], "red")
    assert (made["name"], made["track"], made["phase"], made["state"]) == ("Mine", "negotiation", "dev", "queued")
    assert (server.settings.archives / f"{made['archive_sha256']}.zip").read_bytes() == ZIP
    by_script = upload(red, another_zip(1), script=True)
    assert by_script.status_code == 204 and by_script.headers["hx-redirect"].startswith("/submissions/")


def test_the_same_form_sent_twice_makes_one_submission(red: Visit) -> None:
    action = red.get("/submit").all("form", class_="submit")[0].attributes["action"]
    assert action != red.get("/submit").all("form", class_="submit")[0].attributes["action"]
    first, second = upload(red, path=action), upload(red, path=action)
    assert first.headers["location"] == second.headers["location"]


@pytest.mark.parametrize(
    ("data", "fields", "status", "sentence"),
    [
        (b"no zip", {}, 422, "archive: "),
        (ZIP, {"track": "joint"}, 422, "track joint: expected one agent for all CAVs"),
        (ZIP, {"phase": "past"}, 409, "phase past: it closed at"),
        (ZIP, {"phase": "none"}, 404, "phase: expected one of"),
        (b"0" * 70_000, {}, 413, "archive: expected at most 65536 bytes"),
    ],
)
def test_a_refusal_is_one_sentence_on_the_form_which_keeps_its_input(
    red: Visit, data: bytes, fields: dict[str, str], status: int, sentence: str
) -> None:
    answer = upload(red, data, **fields)
    assert answer.status_code == status
    page = sound(answer)
    (said,) = page.all("p", class_="problem")
    assert sentence in said.text
    assert page.all("input", id="name")[0].attributes["value"] == "My <method>"
    (chosen,) = [each for each in page.all("input", type="radio") if "checked" in each.attributes]
    assert chosen.attributes["value"] == fields.get("track", "negotiation")
    by_script = upload(red, data, script=True, **fields)
    assert by_script.status_code == status
    assert by_script.text.strip().startswith('<p class="problem">') and sentence in by_script.text


def test_a_used_up_quota_is_a_refusal_on_the_form(red: Visit) -> None:
    for number in range(2):
        assert upload(red, another_zip(number)).status_code == 303
    for script in (False, True):
        answer = upload(red, another_zip(2), script=script)
        assert answer.status_code == 429 and answer.headers["retry-after"] == "60"
        assert "2 of at most 2 submissions at a time are unfinished" in answer.text


def test_another_site_cannot_submit(red: Visit) -> None:
    answer = red.client.post("/submit", headers={"Sec-Fetch-Site": "cross-site"})
    assert answer.status_code == 403


def test_an_unfinished_submission_is_polled_and_says_seldom_how_far_it_is(server: Server, red: Visit) -> None:
    id_ = sent(server)
    (live,) = red.get(f"/submissions/{id_}").all("div", id="live")
    assert live.attributes["hx-get"] == f"/submissions/{id_}/progress?seen=0"
    assert live.attributes["hx-trigger"] == "every 2s"
    assert "It is next in the queue." in live.text and "0 of 2 scenarios finished" in live.text
    quiet = red.client.get(live.attributes["hx-get"])
    assert "hx-swap-oob" not in quiet.text and "hx-trigger" not in quiet.headers
    drive(server)
    told = red.client.get(live.attributes["hx-get"])
    assert "1 of 2 scenarios finished" in told.text
    assert "progress?seen=1" in told.text and told.headers["hx-trigger"] == "driven"
    assert ">running, 50 percent finished</p>" in told.text
    assert '<span class="tag ">ok</span>' in told.text and "DS 80.0" in told.text
    finish_rest(server, id_)
    ended = red.client.get(f"/submissions/{id_}/progress?seen=1")
    assert ended.headers["hx-trigger"] == "finished"
    assert "every 2s" not in ended.text and "this submission is done" in ended.text


def finish_rest(server: Server, submission: str) -> None:
    drive(server, failed=True)
    with server.store.write() as session:
        assert submissions.finish_if_complete(session, submission, web_scenes.SUMMARY, NOON + 2 * S)


def test_a_second_submission_waits_behind_the_first(server: Server, red: Visit) -> None:
    sent(server)
    server.now_us += S
    second = sent(server, data=another_zip(1))
    assert "Position 2 in the queue" in red.get(f"/submissions/{second}").words


def test_the_result_with_intervals_buckets_categories_and_what_the_boxes_used(server: Server, red: Visit) -> None:
    id_ = sent(server)
    finish(server, id_)
    page = red.get(f"/submissions/{id_}")
    for words in (
        "DS, % 71.2 95 %: [60.5, 80.5]",
        "SR, % 50.0 95 %: [20.0, 90.0]",
        "Junctions1244.5",
        "crossing1233.5",
        "collision-vehicle 1",
        "36 replies of all agents",
        "the median is ≤ 2 ms",
        "memory of a sandbox 64.0 MB",
        "sandboxes of gvisor.",
        "all sandboxes 25 s",
        "It exceeded the time limit for a reply.",
    ):
        assert words in page.words, words
    assert [each.text for each in page.all("rect")] == ["≤ 1 ms: 8", "≤ 2 ms: 20", "≤ 5 ms: 6", "> 5 ms: 2"]
    assert [float(each.attributes["height"]) for each in page.all("rect")] == pytest.approx([55.2, 138, 41.4, 13.8])


def rows(visit: Visit, path: str) -> list[str]:
    page = visit.get(path)
    return [
        each.text.split()[0] for each in page.all("th", scope="row") if "/scenarios/" in page_links(page, each.text)
    ]


def page_links(page: Page, text: str) -> str:
    return next((each.attributes["href"] for each in page.all("a") if each.text == text.split()[0]), "")


def test_scenarios_are_filtered_and_sorted(server: Server, red: Visit) -> None:
    id_ = sent(server)
    finish(server, id_)
    files(server, id_)
    here = f"/submissions/{id_}"
    swapped = red.client.get(here).text.partition('<section id="scenarios"')[2].partition("</section>")[0]
    assert "/logs/0" in swapped and not without_ids(swapped)
    assert rows(red, here) == ["left-turn", "merge"]
    assert rows(red, f"{here}?sort=ds") == ["merge", "left-turn"]
    assert (rows(red, f"{here}?verdict=ok"), rows(red, f"{here}?verdict=agent-failed")) == (["left-turn"], ["merge"])
    assert rows(red, f"{here}?verdict=failures") == ["left-turn", "merge"]  # one hit a car, the other's agent failed
    assert "No scenarios with this filter" in red.get(f"{here}?verdict=%3Cx%3E").words
    red.get(f"{here}?sort=none", 422)
    (sorted_by,) = [each for each in red.get(f"{here}?sort=ds").all("th") if "aria-sort" in each.attributes]
    assert (sorted_by.text, sorted_by.attributes["aria-sort"]) == ("DS %", "ascending")


def test_who_sees_a_submission(server: Server) -> None:
    id_ = sent(server)
    for who in ("", "blue", "worker"):
        Visit(server, who).get(f"/submissions/{id_}", 404)
        assert Visit(server, who).client.get(f"/submissions/{id_}/progress").status_code == 404
    finish(server, id_)
    files(server, id_)
    stranger = Visit(server).get(f"/submissions/{id_}")
    assert not stranger.all("div", id="actions") and "SHA-256" not in stranger.words
    assert not [each for each in stranger.all("a") if "/logs/" in each.attributes["href"]]
    own = Visit(server, "red").get(f"/submissions/{id_}")
    assert own.all("div", id="actions") and "SHA-256" in own.words
    assert [each for each in own.all("a") if each.attributes["href"].endswith("/left-turn/0/logs/0")]
    assert "Disqualify" not in own.words
    assert "Disqualify" in Visit(server, "admin").get(f"/submissions/{id_}").words


def test_the_page_of_a_scenario_frames_its_replay_without_our_origin(server: Server, red: Visit) -> None:
    id_ = sent(server)
    finish(server, id_)
    files(server, id_, text="<script>alert(1)</script>")
    here = f"/submissions/{id_}/scenarios/left-turn/0"
    page = red.get(here)
    (frame,) = page.all("iframe")
    assert frame.attributes["src"] == f"{here}/replay"
    assert frame.attributes["sandbox"] == "allow-scripts allow-downloads"
    assert "reached the end of its route" in page.words and "collision-vehicle at 2.0 s" in page.words
    assert page.all("a", rel="next")[0].attributes["href"].endswith("/scenarios/merge/0")
    for path, media_type in (
        ("replay", "text/html"),
        ("recording", "application/octet-stream"),
        ("logs/0", "text/plain"),
    ):
        answer = red.client.get(f"{here}/{path}")
        assert answer.status_code == 200 and answer.headers["content-type"].startswith(media_type)
        assert answer.headers["content-security-policy"] == "sandbox allow-scripts allow-downloads"
        assert answer.headers["cache-control"] == "private, no-cache"
    assert Visit(server).client.get(f"{here}/replay").status_code == 200
    assert Visit(server).client.get(f"{here}/logs/0").status_code == 401
    assert Visit(server, "blue").client.get(f"{here}/logs/0").status_code == 404
    assert "agent-failed: timeout" in red.get(f"/submissions/{id_}/scenarios/merge/0").words
    assert "No recording:" in red.get(f"/submissions/{id_}/scenarios/merge/0").words
    red.get(f"/submissions/{id_}/scenarios/none/0", 404)


def test_of_a_hidden_phase_only_the_figures_of_the_whole_are_shown(server: Server, red: Visit) -> None:
    id_ = sent(server, phase="test")
    page = red.get(f"/submissions/{id_}")
    assert "so their progress is not shown" in page.words and "finished</label>" not in page.words
    drive(server)
    for text in (red.get(f"/submissions/{id_}").words, red.client.get(f"/submissions/{id_}/progress").text):
        assert "left-turn" not in text and "merge" not in text and "of 2" not in text
    finish_rest(server, id_)
    page = red.get(f"/submissions/{id_}")
    assert "71.2" in page.words and "are hidden: only DS, rounded to 0.1," in page.words
    assert "left-turn" not in page.words and "Junctions" not in page.words and "answers" not in page.words
    red.get(f"/submissions/{id_}/scenarios/left-turn/0", 403)
    for path in ("replay", "recording", "logs/0"):
        assert red.client.get(f"/submissions/{id_}/scenarios/left-turn/0/{path}").status_code == 403
    assert "left-turn" in Visit(server, "admin").get(f"/submissions/{id_}").words


def test_cancel_hide_and_show(server: Server, red: Visit) -> None:
    id_ = sent(server)
    assert Visit(server, "blue").client.post(f"/submissions/{id_}/cancel", headers=SAME).status_code == 404
    assert Visit(server).client.post(f"/submissions/{id_}/cancel", headers=SAME).status_code == 401
    assert red.post(f"/submissions/{id_}/cancel").headers["location"] == f"/submissions/{id_}"
    page = red.get(f"/submissions/{id_}")
    assert "Cancelled by its team" in page.words and "of the day only" in page.words
    assert "Submit another" in page.words and "/submit?phase=dev" in links(page)
    assert "/submit?phase=dev" not in links(Visit(server, "admin").get(f"/submissions/{id_}"))
    assert "It was not run." in red.get(f"/submissions/{id_}/scenarios/merge/0").words
    red.post(f"/submissions/{id_}/cancel", 409)
    done = sent(server, data=another_zip(1))
    finish(server, done)
    red.post(f"/submissions/{done}/shown", shown="false")
    assert not server.get(f"/submissions/{done}", "red")["shown"]
    assert "Show on the leaderboard" in red.get(f"/submissions/{done}").words
    Visit(server).get(f"/submissions/{done}", 404)
    red.post(f"/submissions/{done}/shown", shown="true")
    assert server.get(f"/submissions/{done}", "red")["shown"]


def test_a_rejected_submission_says_why_and_what_now_and_lists_nothing(server: Server, red: Visit) -> None:
    id_ = sent(server)
    with server.store.write() as session:
        submissions.reject(session, id_, "sensor 'camera': <b>none</b>", NOON)
    page = red.get(f"/submissions/{id_}")
    for words in ("sensor 'camera': <b>none</b>", "nothing is scored. It uses quota only", "No scenario was run."):
        assert words in page.words and "cancelled" not in page.words
    assert [each.text for each in page.all("a", href="/submit?phase=dev")] == ["Fix and submit again"]
    assert server.get("/phases/dev/quota", "red")["today"] == 0


def test_an_admin_repeats_and_disqualifies_with_a_reason(server: Server, red: Visit) -> None:
    id_ = sent(server)
    finish(server, id_)
    admin = Visit(server, "admin")
    for path in ("rerun", "disqualify"):
        red.post(f"/submissions/{id_}/{path}", 404, reason="x")
    again = admin.post(f"/submissions/{id_}/rerun").headers["location"]
    assert again != f"/submissions/{id_}" and "Waiting in the queue." in admin.get(again).words
    admin.post(f"/submissions/{id_}/disqualify", 422, reason=" ")
    admin.post(f"/submissions/{id_}/disqualify", reason="<b>read the map</b>")
    page = red.get(f"/submissions/{id_}")
    assert page.all("p", class_="problem")[0].text == "<b>read the map</b>"
    assert server.get("/leaderboards/dev")["rows"] == []
