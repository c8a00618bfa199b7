"""The pages of leaderboards: ranks, filters, order, and what is kept of them."""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from sqlalchemy import select
from testing import databases
from testing.api_app import HIDDEN, Server
from testing.store_samples import NOON
from testing.web_page import PAPER, Visit, driven, first_table, links

from mdrive_sumo.scoring.metrics import list_scalar_metrics
from server.api.schemas.submissions import FiguresOut
from server.clock import DAY_US
from server.enums import TokenScope
from server.store import Store, phases, teams, tokens
from server.store.tables import SubmissionRow
from server.web import templating
from server.web.board_view import SCALAR_COLUMNS

pytestmark = pytest.mark.slow


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path)


def test_an_empty_board_says_what_to_do(server: Server) -> None:
    page = Visit(server).get("/?phase=dev")
    assert "No submissions yet. Submit an agent" in page.words and "/how" in links(page)
    assert "The phase is not open for submissions now" in Visit(server).get("/?phase=past").words
    assert "with this filter" in Visit(server).get("/?phase=dev&track=joint").words


def test_the_board_names_the_season_of_a_public_suite_and_the_checksum(server: Server) -> None:
    assert "Scenarios: interdrive@0." in Visit(server).get("/?phase=dev").words
    driven(server, "red", 41.0)
    with server.store.write() as session:
        for row in session.scalars(select(SubmissionRow)):
            row.evaluator = row.evaluator | {"suite": "sha256:0123456789abcdef"}
    server.now_us += DAY_US
    assert "Scenarios: interdrive@0 (checksum 0123456789ab)." in Visit(server).get("/?phase=dev").words
    assert "Scenarios:" not in Visit(server).get("/?phase=test").words, "hidden, and without a submission"


def test_a_server_without_phases_says_so(server: Server) -> None:
    with server.store.write() as session:
        for phase in phases.list_phases(session):
            session.delete(phase)
    assert "No phases yet" in Visit(server).get("/").words
    assert "No phases yet" in Visit(server).get("/how").words
    assert Visit(server).client.get("/leaderboard.csv").status_code == 404


def test_the_board_that_is_shown_without_a_wish(server: Server) -> None:
    """Of the open phases the one that opened last; of those that opened together a public one."""
    later = [HIDDEN.__class__("soon", "Soon", "interdrive", True, NOON + DAY_US, NOON + 9 * DAY_US, 1, 1, 1)]
    with server.store.write() as session:
        phases.set_phases(session, later, NOON)
    visit = Visit(server)
    assert [each.text for each in visit.get("/").all("a", aria_current="page")][1:] == ["Development open"]
    server.now_us += DAY_US
    assert [each.text for each in visit.get("/").all("a", aria_current="page")][1:] == ["Soon open"]


def test_sensing_tracks_have_ranks_of_their_own(server: Server) -> None:
    driven(server, "red", 70.0, "object")
    assert "Perception: agents" not in Visit(server).get("/?phase=dev").words
    by_lidar = driven(server, "red", 40.0, "sensor", name="by lidar")
    driven(server, "blue", 90.0, "sensor")
    page = Visit(server).get("/?phase=dev")
    assert first_table(page) == ["red", "blue", "red"] and "The two are ranked apart" in page.words
    assert first_table(Visit(server).get("/?phase=dev&sensing_track=sensor")) == ["blue", "red"]
    assert "sensor track" in Visit(server).get(f"/submissions/{by_lidar}").words
    assert Visit(server).client.get("/?phase=dev&sensing_track=radar").status_code == 404
    rows = list(csv.DictReader(io.StringIO(Visit(server).client.get("/leaderboard.csv?phase=dev").text)))
    found = [(row["rank"], row["team"], row["sensing_track"]) for row in rows if row["published"] == "False"]
    assert found == [("1", "red", "object"), ("1", "blue", "sensor"), ("2", "red", "sensor")]
    board = Visit(server).client.get("/api/v1/leaderboards/dev?sensing_track=sensor").json()
    assert [row["team"] for row in board["rows"]] == ["blue", "red"] and board["sensing_track"] == "sensor"


def test_ranks_figures_intervals_and_links(server: Server) -> None:
    low, high = driven(server, "red", 41.25), driven(server, "blue", 80.0, name="planner")
    page = Visit(server).get("/?phase=dev")
    assert first_table(page) == ["blue", "red"]
    assert "80.0 [75.0, 85.0]" in page.words and "planner" in page.words and "2026" not in page.words
    assert {f"/submissions/{low}", f"/submissions/{high}"} <= set(links(page)) and f"/teams/{server.red}" in links(page)
    assert [each.attributes["aria-label"] for each in page.all("svg", role="img")] == [
        "DS of one submission: 80.0", "DS of one submission: 41.2",
    ]  # fmt: skip
    driven(server, "red", 60.0)
    spark = Visit(server).get("/?phase=dev").all("svg", role="img")[1]
    assert spark.attributes["aria-label"] == "DS of 2 submissions, the first 41.2, the last 60.0"


def test_published_rows_stand_apart(server: Server) -> None:
    driven(server, "red", 41.0)
    page = Visit(server).get("/?phase=dev")
    assert [each.text for each in page.all("th", scope="row", class_="words")] == ["red", *PAPER]
    assert len(page.all("table")) == 2 and "CARLA, for comparison only" in page.words
    assert len(Visit(server).get("/?phase=dev&part=category:merge").all("table")) == 1


@pytest.mark.parametrize("backend", databases.BACKENDS)
def test_filters(tmp_path: Path, backend: str) -> None:
    server = Server(tmp_path, store=databases.emptied(backend))
    driven(server, "red", 41.0)
    driven(server, "blue", 80.0, track="negotiation")
    visit = Visit(server)
    assert first_table(visit.get("/?phase=dev&track=negotiation&part="))[:1] == ["blue"]
    assert first_table(visit.get("/?phase=dev&part=bucket:InterDrive")) == ["red", "blue"]
    page = visit.get("/?phase=dev&bucket=InterDrive")
    assert [each.attributes["value"] for each in page.all("option", selected="")] == ["bucket:InterDrive"]
    assert "category:merge" in [each.attributes["value"] for each in page.all("option")]
    assert "ranked separately" in visit.get("/?phase=dev&track=joint").words
    for query, words in (
        ("phase=nope", "expected one of dev, past, test"), ("track=x", "track: expected one of single-agent"),
        ("part=bucket:nope", "bucket: expected one of InterDrive"), ("category=x", "category: expected one of merge"),
        ("sort=x", "sort: expected one of rank"),
    ):  # fmt: skip
        assert words in visit.get(f"/?{'' if 'phase' in query else 'phase=dev&'}{query}", 404).words
    assert "found both" in visit.get("/?phase=dev&bucket=InterDrive&category=merge", 422).words
    for part in ("nope:InterDrive", "bucket", "bucket:"):
        assert "part: expected bucket:NAME" in visit.get(f"/?phase=dev&part={part}", 422).words
    for number in ("0", "x", "-1", "²", "9" * 30, "000000001" + "9" * 5000):
        assert "page: expected a number" in visit.get(f"/?phase=dev&page={number}", 422).words


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visit]:
    """A visitor of a board of three teams, one of them driven by an older evaluator; with a database of its own."""
    folder = tmp_path_factory.mktemp("three")
    store = Store(f"sqlite:///{folder / 'challenge.sqlite'}")
    store.migrate()
    server = Server(folder, store)
    with store.write() as session:
        server.tokens["green"] = tokens.issue(session, teams.create(session, "green", NOON), TokenScope.SUBMIT, NOON)

    def older(*_: object) -> dict[str, str]:
        return {"version": "0"}

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("testing.api_app.FakeSuites.evaluator", older)
        driven(server, "green", 90.0, name="b")
    driven(server, "red", 41.0, name="A")
    driven(server, "blue", 80.0, name="c")
    yield Visit(server)
    store.close()


@pytest.mark.parametrize(
    ("sort", "order"),
    [
        ("rank", ["blue", "red", "green"]),
        ("rank&turned=1", ["red", "blue", "green"]),  # a row without a rank stands last either way
        ("team", ["blue", "green", "red"]),
        ("team&turned=1", ["red", "green", "blue"]),
        ("method", ["red", "green", "blue"]),
        ("ds", ["green", "blue", "red"]),
        ("sr", ["red", "blue", "green"]),
        ("efficient_sr", ["red", "blue", "green"]),
        ("time_ratio", ["red", "blue", "green"]),
        ("time_ratio&turned=1", ["green", "blue", "red"]),
        ("mean_speed&columns=beside", ["green", "blue", "red"]),
        ("message_rate&columns=beside", ["red", "blue", "green"]),
        ("date", ["blue", "red", "green"]),
    ],
)
def test_order(three: Visit, sort: str, order: Sequence[str]) -> None:
    page = three.get(f"/?phase=dev&sort={sort}")
    assert first_table(page) == order
    assert "cannot be compared" in page.words
    falling = (sort.partition("&")[0] in ("ds", "sr", "efficient_sr", "mean_speed", "date")) != ("turned" in sort)
    sorted_by = [each for each in page.all("th", scope="col") if "aria-sort" in each.attributes]
    assert [each.attributes["aria-sort"] for each in sorted_by] == ["descending" if falling else "ascending"]
    again = page.all("a", id=f"sort-{sort.partition('&')[0]}")[0].attributes["href"]
    assert ("turned=1" in again) is ("turned=1" not in sort), "the same column again turns it round"


def test_columns_of_scalars_are_optional_and_those_of_the_metrics(server: Server) -> None:
    mine = driven(server, "red", 41.0)
    titles = [column.title for column in SCALAR_COLUMNS]
    names = ["mean_speed", "comfort", "min_ttc", "min_pet", "message_rate", "speeding"]
    assert [column.name for column in SCALAR_COLUMNS] == names
    assert {column.name for column in SCALAR_COLUMNS} == {metric.name for metric in list_scalar_metrics()}
    plain, beside = (Visit(server).get(f"/?phase=dev{more}") for more in ("", "&columns=beside"))
    headers = [[each.text for each in page.all("th", scope="col")] for page in (plain, beside)]
    assert "IP" in headers[0] and not {*titles} & {*headers[0]}
    assert "IP" not in headers[1] and [text for text in headers[1] if text in titles] == titles
    assert len(headers[1]) == len(headers[0]) + 1  # six replace four and the history
    assert [each.text for each in beside.all("td", class_="number")][3:9] == ["4.10", "99.0", "–", "1.2", "41", "2.0"]
    assert "columns=beside" in beside.all("a", id="sort-team")[0].attributes["href"]
    Visit(server).get("/?phase=dev&columns=none", status=404)
    row = server.get("/leaderboards/dev")["rows"][0]
    assert row["figures"]["scalars"]["mean_speed"] == pytest.approx(4.1)
    lines = Visit(server).client.get("/leaderboard.csv?phase=dev").text.splitlines()
    assert ",".join(names) in lines[0] and ",4.1,99.0,,1.2,41.0,2.0," in lines[1]
    words = Visit(server).get(f"/submissions/{mine}").words
    assert "Speed, comfort, close encounters, messages" in words and "Least TTC s" in words


def test_a_long_board_has_pages(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    driven(server, "red", 41.0)
    driven(server, "blue", 80.0)
    monkeypatch.setattr("server.web.leaderboard_page.ROWS_PER_PAGE", 1)
    page = Visit(server).get("/?phase=dev&sort=team")
    assert first_table(page) == ["blue"] and "Page 1 of 2" in page.words
    following = page.all("a", id="page-next")[0].attributes["href"]
    page = Visit(server).get(following)
    assert first_table(page) == ["red"] and not page.all("a", id="page-next") and page.all("a", id="page-previous")
    assert first_table(Visit(server).get("/?phase=dev&page=99")) == ["red"]


def test_htmx_gets_the_board_alone(server: Server) -> None:
    driven(server, "red", 41.0)
    answer = Visit(server).client.get("/?phase=dev", headers={"HX-Request": "true"})
    assert answer.text.startswith('<div id="board"') and "<html" not in answer.text and "red" in answer.text
    assert "HX-Request" in answer.headers["vary"]
    whole = Visit(server).client.get("/?phase=dev").text
    assert answer.text.strip() in whole


def test_a_kept_page_shows_who_is_logged_in_to_them_only(server: Server) -> None:
    driven(server, "red", 41.0)
    for who, word in (("red", "Log out"), ("", "Log in"), ("admin", "Admin"), ("blue", "blue")):
        page = Visit(server, who).get("/?phase=dev")
        assert word in page.all("nav", aria_label="Pages")[0].text
        assert "/admin" not in links(page) or who == "admin"
    assert Visit(server, "red").client.get("/").headers["cache-control"] == "no-store"
    assert Visit(server).client.get("/").headers["cache-control"] == "public, max-age=1"


def test_the_board_for_other_programs(server: Server) -> None:
    with server.store.write() as session:
        server.tokens["sheet"] = tokens.issue(session, teams.create(session, "=1+1", NOON), TokenScope.SUBMIT, NOON)
    driven(server, "sheet", 41.0, name="-2")
    page = Visit(server).get("/?phase=dev&track=single-agent&bucket=InterDrive&sort=sr")
    (as_csv,) = links(page, "/leaderboard.csv")
    (as_json,) = links(page, "/api/v1/leaderboards/")
    answer = Visit(server).client.get(as_csv)
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert answer.headers["content-type"] == "text/csv; charset=utf-8"
    assert answer.headers["cache-control"] == "public, max-age=1"
    assert (rows[0]["rank"], rows[0]["team"], rows[0]["method"], rows[0]["ds"]) == (
        "1",
        "'=1+1",
        "-2",
        "58.0",
    )  # a number is none
    assert [(row["published"], row["rank"]) for row in rows] == [("False", "1"), *[("True", "")] * 4]
    told = server.client.get(as_json).json()
    assert (told["track"], told["bucket"], told["rows"][0]["figures"]["ds"]) == ("single-agent", "InterDrive", 58.0)


def test_a_score_without_interval_is_shown_without() -> None:
    """As of few scenarios, for which the summary has none."""
    figures = FiguresOut(ds=80.0, ds_low=75.0, ds_high=85.0, scenarios=10)
    assert templating.format_interval(figures, "ds") == "[75.0, 85.0]"
    assert templating.format_interval(figures, "sr") == ""
