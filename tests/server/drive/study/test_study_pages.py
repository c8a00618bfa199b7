"""Participants go through the study over HTTP: consent, practice, drives, questions, breaks, thanks, withdrawal."""

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest
from testing.api_client import Client
from testing.human_study import FIRST, PAIRED, MadeDrives, make_plan

from mdrive_sumo.study.human.human_study_folder import ORGANISER, HumanStudyFolder
from mdrive_sumo.study.human.participant_progress import DriveEntry
from server.drive.drive_app import create_drive_app
from server.drive.drive_host import DriveHost
from server.drive.study import study_service
from server.drive.study.study_drives import choose_take
from server.drive.study.study_pages import mount_study
from server.drive.study.study_service import StudyService
from server.drive.take_tree import Take, TakeStatus


@dataclass
class Stage:
    """A served study, its clock, and drives that end when a test says so."""

    study: HumanStudyFolder
    drives: MadeDrives
    client: Client
    service: StudyService
    time: list[int] = field(default_factory=lambda: [1_800_000_000])

    def token(self, code: str) -> str:
        return self.study.load_links()[code]

    def get(self, code: str = "P01", page: str = "/study") -> httpx.Response:
        return self.client.get(page, params={"token": self.token(code)})

    def post(self, page: str, code: str = "P01", **form: Any) -> httpx.Response:
        return self.client.post(f"/study/{page}", params={"token": self.token(code)}, data=form)

    def open(self, code: str = "P01") -> str:
        """Begin the next drive; return where the browser is sent."""
        token = self.token(code)
        return self.client.post("/study/drive", params={"token": token}, follow_redirects=False).headers["location"]

    def drive(self, code: str = "P01") -> DriveEntry:
        """Begin the next drive and let it be stored."""
        assert self.open(code).startswith("/drive/")
        entry = self.drives.opened[-1]
        self.drives.end(entry)
        return entry


def make_stage(folder: Path, **plan: Any) -> Stage:
    study = HumanStudyFolder.create(folder / "study", make_plan(**plan), "persons")
    drives, app, time = MadeDrives(study), create_drive_app(DriveHost()), [1_800_000_000]
    service = StudyService(study, drives, lambda: time[0])
    mount_study(app, service)
    return Stage(study, drives, Client(app, base_url="http://127.0.0.1"), service, time)


@pytest.fixture(autouse=True)
def successes(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether the next drives succeed; all do by default."""
    outcomes: list[bool] = []
    monkeypatch.setattr(study_service, "is_success", lambda *_: outcomes.pop(0) if outcomes else True)
    return outcomes


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    return make_stage(tmp_path)


def title(page: httpx.Response) -> str:
    found = re.search(r"<h1>(.*?)</h1>", page.text)
    assert found is not None, page.text
    return found[1]


def test_a_participant_goes_from_consent_to_thanks(tmp_path: Path) -> None:
    stage = make_stage(tmp_path, scenarios=[FIRST], practice={"scenarios": [FIRST], "drives": 1})
    page = stage.get()
    assert title(page) == "Welcome" and "Taking part is voluntary." in page.text
    assert title(stage.post("consent", agree="yes")) == "Practice drive 1"
    stage.drive()
    assert title(stage.get()) == "Drive 1"
    stage.drive()
    assert title(stage.get()) == "About this drive"
    refused = stage.post("answers", safe="9")
    assert refused.status_code == 422 and "expected a number from 1 to 7, found &#39;9&#39;" in refused.text
    assert title(stage.post("answers", safe="6")) == "Drive 2"
    stage.drive()
    assert title(stage.post("answers", safe="2")) == "Questions at the end"
    assert title(stage.post("answers", comment="")) == "Thank you"
    progress = stage.study.load_progress("P01")
    assert [entry.answers for entry in progress.list_drives("counted")] == [{"safe": 6.0}, {"safe": 2.0}]
    assert progress.end_answers == {"comment": None}
    assert stage.drives.closed == [entry.folder for entry in progress.drives]


def test_nothing_begins_without_consent(stage: Stage) -> None:
    assert stage.post("consent").status_code == 422
    assert stage.post("drive").url.path == "/study"
    assert not stage.drives.opened and stage.study.load_progress("P01").consented_at is None


def test_conditions_are_told_before_a_drive_and_kept_in_the_order_of_the_plan(stage: Stage) -> None:
    stage.post("consent", agree="yes")
    seen: list[bool] = []
    for _ in range(4):
        seen.append("The screen shows what other connected cars tell." in stage.get().text)
        stage.drive()
        stage.post("answers", safe="1")
    assert seen == [True, True, False, False]
    assert stage.drives.return_paths == {0: f"/study?token={stage.token('P01')}"}


def test_a_page_that_is_loaded_anew_or_sent_twice_changes_nothing(stage: Stage) -> None:
    for _ in range(2):
        stage.post("consent", agree="yes")
    for _ in range(2):
        stage.open()
    assert title(stage.get()) == "Your drive goes on"
    assert len(stage.study.load_progress("P01").drives) == 1 and len(stage.drives.opened) == 2
    stage.drives.end(stage.drives.opened[0])
    for _ in range(2):
        stage.post("answers", safe="4")
    assert len(stage.study.load_progress("P01").drives) == 1
    assert title(stage.get()) == "Drive 2"


def test_a_server_that_is_started_anew_goes_on_where_it_was_killed(stage: Stage, tmp_path: Path) -> None:
    stage.post("consent", agree="yes")
    stage.open()
    again = make_stage(tmp_path)
    assert again.token("P01") == stage.token("P01")
    assert title(again.get()) == "Your drive goes on"
    again.open()
    assert again.drives.opened[0] == stage.drives.opened[0]
    again.drives.end(again.drives.opened[0])
    assert title(again.get()) == "About this drive"


def test_breaks_are_kept(tmp_path: Path) -> None:
    stage = make_stage(tmp_path, breaks={"between_drives_s": 60, "session_min": 30, "between_sessions_h": 3})
    stage.post("consent", agree="yes")
    stage.drive()
    stage.post("answers", safe="1")
    assert title(stage.get()) == "Short break"
    assert stage.post("drive").url.path == "/study" and len(stage.drives.opened) == 1
    stage.time[0] += 60
    assert title(stage.get()) == "Drive 2"
    stage.time[0] += 1800
    page = stage.get()
    assert title(page) == "The session is over" and "UTC" in page.text
    stage.time[0] += 3 * 3600
    assert title(stage.get()) == "Drive 2"


def test_practice_lasts_until_it_succeeds(tmp_path: Path, successes: list[bool]) -> None:
    practice = {"scenarios": [FIRST], "successes": 2, "at_most": 9}
    stage = make_stage(tmp_path, practice=practice)
    successes[:] = [True, False, True, True]
    stage.post("consent", agree="yes")
    for number in range(1, 5):
        assert title(stage.get()) == f"Practice drive {number}"
        stage.drive()
    assert title(stage.get()) == "Drive 1"


def test_a_drive_can_be_ended_early(stage: Stage) -> None:
    stage.post("consent", agree="yes")
    stage.open()
    stage.post("give-up")
    assert stage.drives.left == [stage.drives.opened[0].folder]
    assert title(stage.get()) == "Your drive goes on"  # until its take is stored


def test_withdrawal_deletes_everything_and_says_so(stage: Stage) -> None:
    stage.post("consent", agree="yes")
    stage.drive()
    stage.post("answers", safe="3")
    stage.open()
    page = stage.get(page="/study/withdraw")
    assert "Delete everything and withdraw" in page.text and stage.study.load_progress("P01").drives
    assert title(stage.post("withdraw")) == "You have withdrawn"
    assert set(stage.drives.closed) == {entry.folder for entry in stage.drives.opened}
    left = [path for path in stage.study.folder.rglob("*") if path.is_file()]
    assert {path.name for path in left} == {"study.json", "links.json", "withdrawals.json"}
    assert json.loads((stage.study.folder / "withdrawals.json").read_text()) == [{"code": "P01", "at": stage.time[0]}]
    assert title(stage.get()) == "You have withdrawn"
    for page_name in ("consent", "drive", "answers", "give-up"):
        assert stage.post(page_name, agree="yes").status_code == 410
    overview = stage.get(ORGANISER, "/study/overview")
    assert "withdrew at 2027-01-15 08:00 UTC; nothing is kept" in overview.text
    assert stage.token("P01") not in overview.text


def test_a_partner_who_withdraws_ends_the_common_drive(tmp_path: Path) -> None:
    stage = make_stage(tmp_path, conditions=PAIRED[1:], scenarios=[FIRST])
    for code in ("P01", "P02"):
        stage.post("consent", code, agree="yes")
        stage.open(code)
    first, second = stage.drives.opened
    assert first.folder == second.folder and (first.cav, second.cav) == (0, 1)
    assert {*stage.drives.return_paths} == {0, 1}
    stage.post("withdraw", "P02")
    assert title(stage.get("P01")) == "Questions at the end"
    assert stage.study.load_progress("P01").drives[0].is_lost


def test_the_drive_of_a_pair_is_closed_when_both_have_seen_its_end(tmp_path: Path) -> None:
    stage = make_stage(tmp_path, conditions=PAIRED[1:], scenarios=[FIRST])
    for code in ("P01", "P02"):
        stage.post("consent", code, agree="yes")
        stage.open(code)
    stage.drives.end(stage.drives.opened[0])
    assert title(stage.get("P01")) == "About this drive" and stage.drives.closed == []
    assert title(stage.get("P02")) == "About this drive" and len(stage.drives.closed) == 1


def test_the_organiser_sees_links_and_progress(stage: Stage) -> None:
    stage.post("consent", agree="yes")
    stage.drive()
    page = stage.get(ORGANISER, "/study/overview")
    assert page.status_code == 200
    assert all(stage.token(code) in page.text for code in stage.study.plan.codes)
    assert re.search(r"<td>P01</td>\s*<td>driving</td><td>0</td><td>0 of 4</td>", page.text)
    stage.get()
    assert "<td>questions</td><td>0</td><td>1 of 4</td>" in stage.get(ORGANISER, "/study/overview").text


@pytest.mark.parametrize("page", ["/study", "/study/step", "/study/withdraw", "/study/overview"])
@pytest.mark.parametrize("token", ["", "x", "\udcff", None])
def test_nobody_gets_in_without_a_link(stage: Stage, page: str, token: str | None) -> None:
    given = {} if token is None else {"token": token.encode("utf-8", "surrogateescape").decode("latin-1")}
    answer = stage.client.get(page, params=given)
    assert answer.status_code == 403 and "link" in answer.text


def test_a_participant_is_no_organiser_and_the_organiser_no_participant(stage: Stage) -> None:
    assert stage.get("P01", "/study/overview").status_code == 403
    assert stage.get(ORGANISER, "/study").status_code == 403


def test_pages_allow_no_script_but_their_own(stage: Stage) -> None:
    for page in (stage.get(), stage.get(ORGANISER, "/study/overview"), stage.get(page="/study/withdraw")):
        policy = page.headers["content-security-policy"]
        assert "default-src 'none'" in policy and "form-action 'self'" in policy and "unsafe" not in policy
        assert page.headers["referrer-policy"] == "no-referrer" and page.headers["cache-control"] == "no-store"
        assert not re.search(r"<script(?![^>]* src=)|\son\w+=|style=", page.text)
    for name in ("study.css", "study.js"):
        assert stage.client.get(f"/study/static/{name}").status_code == 200
    assert stage.client.get("/study/static/../../secrets").status_code == 404


def test_texts_of_the_plan_are_no_markup(tmp_path: Path) -> None:
    stage = make_stage(tmp_path, title="<b>x</b>", consent="<script>alert(1)</script>")
    assert "&lt;script&gt;alert(1)" in stage.get().text and "<b>x</b>" not in stage.get().text


def test_a_form_that_is_too_large_is_refused(stage: Stage) -> None:
    stage.post("consent", agree="yes")
    stage.drive()
    assert stage.post("answers", safe="1", more="x" * 1_100_000).status_code == 413
    assert stage.get().status_code == 200


def test_waiting_pages_are_told_of_the_next_step(stage: Stage) -> None:
    assert stage.get(page="/study/step").json() == {"step": "consent", "drives": 0}
    stage.post("consent", agree="yes")
    stage.open()
    assert stage.get(page="/study/step").json() == {"step": "driving", "drives": 1}
    stage.drives.end(stage.drives.opened[0])
    assert stage.get(page="/study/step").json() == {"step": "questions", "drives": 1}
    stage.post("withdraw")
    assert stage.get(page="/study/step").json() == {"step": "withdrawn", "drives": 0}


def test_the_newest_take_counts_once_it_is_stored() -> None:
    finished, left = TakeStatus.FINISHED, TakeStatus.LEFT
    assert choose_take([]) is None
    assert choose_take([Take(1)]) is None
    assert choose_take([Take(1, status=finished), Take(2, 1, 50)]) is None  # continued after a crash
    assert choose_take([Take(1, status=finished), Take(2, 1, 50, status=left)]) is None
    chosen = choose_take([Take(1, status=finished, left_tick=60), Take(2, 1, 50, status=finished)])
    assert chosen is not None and chosen.number == 2
