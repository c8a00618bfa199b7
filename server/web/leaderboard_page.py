"""The leaderboard page, rendered once for all visitors who are not logged in and cached until a board changes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request, Response
from markupsafe import Markup
from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.contract import SensingTrack
from mdrive_sumo.core.checksum import SHORT_CHECKSUM
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.season import read_stored_name
from server.api import submission_views
from server.api.csv_format import csv_headers
from server.api.dependencies import Services, get_now
from server.api.leaderboard_cache import FRESH_US, STALE_US
from server.api.leaderboards import BoardKey, PhaseParts, list_parts, read_leaderboard
from server.api.schemas.leaderboards import LeaderboardOut, RowOut
from server.api.schemas.submissions import FiguresOut
from server.enums import ChallengeTrack
from server.store import NotFound, phases, queries, teams
from server.store.tables import SubmissionRow
from server.tracks import SENSING_LABELS, TRACK_LABELS
from server.web import charts
from server.web.board_view import COLUMNS_BESIDE, SCALAR_BY_NAME, SCALAR_COLUMNS, SORTS, BoardView, format_csv
from server.web.templating import page_headers, render
from server.web.visitor import get_visitor

router = APIRouter()
ROWS_PER_PAGE = 50
"""Rows per page."""
_VISITOR_MARK = "<!--visitor-->"
"""Marks where the visitor's part is inserted into a cached page."""


@dataclass(frozen=True, slots=True)
class PhaseTab:
    """The tab of a phase."""

    id: str
    title: str
    public: bool
    opens_us: int
    closes_us: int
    suite: str = ""
    """Name of a public suite with its season; "" of a hidden one."""
    checksum: str = ""
    """Beginning of the checksum of the suite of the latest submission; "" before the first."""


@dataclass(frozen=True, slots=True)
class _RenderedBoard:
    """A rendered page."""

    whole: bytes
    """The page for visitors who are not logged in."""
    before: bytes
    after: bytes
    """The page before and after the visitor's part."""
    board: bytes
    """The part that changes with a filter."""


async def build_page(services: Services, which: BoardKey, at_us: int) -> None:
    """Render the page of a board into the cache. Raises NotFound and StoreUnavailable."""
    tabs = await services.leaderboards.get("tabs", _list_tabs, at_us, FRESH_US)
    parts = await _get_parts(which.phase, services, at_us, FRESH_US)
    await _get_page(BoardView(which), tabs, parts, services, at_us, FRESH_US)


@router.get("/")
async def show(request: Request) -> Response:
    """Show a leaderboard; without a phase, that of the open phase that opened last."""
    services: Services = request.app.state.services
    at_us = await get_now(request)
    visitor = await get_visitor(request, services)
    tabs = await services.leaderboards.get("tabs", _list_tabs, at_us)
    if not tabs:
        text = render("board_none.html", visitor=visitor)
        return Response(text, media_type="text/html", headers=page_headers(visitor is not None))
    view, parts = await _parse_view(request.query_params, services, tabs, at_us)
    made = await _get_page(view, tabs, parts, services, at_us)
    if request.headers.get("hx-request") == "true":
        content = made.board
    elif visitor is None:
        content = made.whole
    else:
        content = b"".join((made.before, render("visitor.html", visitor=visitor, here="boards").encode(), made.after))
    headers = page_headers(visitor is not None) | {"Vary": "Cookie, HX-Request"}
    return Response(content, media_type="text/html", headers=headers)


@router.get("/leaderboard.csv")
async def show_csv(request: Request) -> Response:
    """Return the same board as CSV; the API returns it as JSON."""
    services: Services = request.app.state.services
    at_us = await get_now(request)
    tabs = await services.leaderboards.get("tabs", _list_tabs, at_us)
    if not tabs:
        raise NotFound("phase: no phases yet")
    view, _ = await _parse_view(request.query_params, services, tabs, at_us)
    board = LeaderboardOut.model_validate_json(await services.leaderboards.get_json(view.key, at_us))
    headers = csv_headers(f"leaderboard-{board.phase}") | {"Cache-Control": "no-cache"}
    return Response(format_csv(board), media_type="text/csv", headers=headers)


async def _get_page(
    view: BoardView,
    tabs: Sequence[PhaseTab],
    parts: PhaseParts,
    services: Services,
    at_us: int,
    stale_us: int = STALE_US,
) -> _RenderedBoard:
    now_open = frozenset(tab.id for tab in tabs if tab.opens_us <= at_us < tab.closes_us)
    render_board = partial(_render_page, view=view, tabs=tabs, parts=parts, now_open=now_open)
    return await services.leaderboards.get((view, tabs, parts, now_open), render_board, at_us, stale_us)


async def _get_parts(phase: str, services: Services, at_us: int, stale_us: int = STALE_US) -> PhaseParts:
    return await services.leaderboards.get(("parts", phase), partial(list_parts, phase_id=phase), at_us, stale_us)


async def _parse_view(
    query: Mapping[str, str], services: Services, tabs: Sequence[PhaseTab], at_us: int
) -> tuple[BoardView, PhaseParts]:
    """Return the requested view, and the parts of its phase. Raises NotFound and InputError."""
    phase = query.get("phase") or _default_tab(tabs, at_us).id
    if phase not in (tab.id for tab in tabs):
        raise NotFound(f"phase: expected one of {', '.join(tab.id for tab in tabs)}, found {phase!r:.60}")
    parts = await _get_parts(phase, services, at_us)
    kind, _, name = query.get("part", "").partition(":")  # from the form, in which only one of the two can be chosen
    if kind and (kind not in ("bucket", "category") or not name):
        raise InputError(f"part: expected bucket:NAME or category:NAME, found {query['part']!r:.80}")
    given = {kind: name} if kind else query
    bucket, category = _parse_choice(given, "bucket", parts.buckets), _parse_choice(given, "category", parts.categories)
    if bucket is not None and category is not None:
        raise InputError(f"leaderboard: expected a bucket or a category, found both: {bucket!r} and {category!r}")
    track = _parse_choice(query, "track", tuple(ChallengeTrack))
    number = query.get("page") or "1"
    if not (number.isascii() and number.isdecimal() and len(number) <= 5 and 1 <= int(number) <= 10_000):
        raise InputError(f"page: expected a number from 1 to 10000, found {number!r:.60}")
    sensing = _parse_choice(query, "sensing_track", tuple(SensingTrack))
    which = BoardKey(
        phase,
        ChallengeTrack(track) if track else None,
        bucket,
        category,
        SensingTrack(sensing) if sensing else None,
    )
    sort, turned = (
        _parse_choice(query, "sort", tuple(SORTS)) or "rank",
        _parse_choice(query, "turned", ("1",)) is not None,
    )
    columns = _parse_choice(query, "columns", (COLUMNS_BESIDE,)) or ""
    return BoardView(which, sort, turned, int(number), columns), parts


def _parse_choice(query: Mapping[str, str], name: str, choices: Sequence[str]) -> str | None:
    choice = query.get(name) or None
    if choice is not None and choice not in choices:
        raise NotFound(f"{name}: expected one of {', '.join(choices) or 'none so far'}, found {choice!r:.80}")
    return choice


def _default_tab(tabs: Sequence[PhaseTab], at_us: int) -> PhaseTab:
    """Return the open phase that opened last, of several a public one; else the last closed one; else the last one."""
    begun = [tab for tab in tabs if tab.opens_us <= at_us]
    still = [tab for tab in begun if at_us < tab.closes_us]
    return max(reversed(still or begun or tabs), key=lambda tab: (tab.opens_us, tab.public))


def _list_tabs(session: Session) -> tuple[PhaseTab, ...]:
    return tuple(
        PhaseTab(
            each.id,
            each.title,
            each.public,
            each.opens_us,
            each.closes_us,
            read_stored_name(Path(each.suite).name) if each.public else "",
            _find_suite_checksum(session, each.id),
        )
        for each in phases.list_phases(session)
    )


def _find_suite_checksum(session: Session, phase: str) -> str:
    newest = select(SubmissionRow.evaluator).where(SubmissionRow.phase == phase)
    evaluator = session.scalars(newest.order_by(SubmissionRow.created_us.desc()).limit(1)).first() or {}
    return str(evaluator.get("suite", "")).removeprefix("sha256:")[:SHORT_CHECKSUM]


@dataclass(frozen=True, slots=True)
class BoardLine:
    """A row of the table."""

    row: RowOut
    team_id: str
    sparkline: charts.Sparkline


def _render_page(
    session: Session, view: BoardView, tabs: Sequence[PhaseTab], parts: PhaseParts, now_open: frozenset[str]
) -> _RenderedBoard:
    board, phase = read_leaderboard(session, view.key), phases.get(session, view.key.phase)
    rows = sorted(
        board.rows, key=lambda row: _sort_key(row, view.sort), reverse=SORTS[view.sort] is not view.is_reversed
    )
    rows.sort(key=lambda row: _sort_value(row, view.sort) is None)  # unknown values come last
    if view.sort == "rank":  # of the two tracks, which have ranks of their own
        rows.sort(key=lambda row: row.sensing_track != SensingTrack.OBJECT)
    pages = max(1, -(-len(rows) // ROWS_PER_PAGE))
    page = min(view.page, pages)
    context: dict[str, Any] = {
        "view": view,
        "tab": next(tab for tab in tabs if tab.id == board.phase),
        "parts": parts,
        "tracks": TRACK_LABELS,
        "sensing": SENSING_LABELS,
        "is_mixed": len({row.sensing_track for row in rows}) > 1,
        "scalars": SCALAR_COLUMNS if view.columns == COLUMNS_BESIDE else (),
        "falling": {name for name, is_falling in SORTS.items() if is_falling},
        "lines": _make_lines(session, view.key, rows[(page - 1) * ROWS_PER_PAGE : page * ROWS_PER_PAGE]),
        "teams": len({row.team for row in rows}),
        "pages": pages,
        "page": page,
        "unranked": any(row.rank is None for row in rows),
        "published": board.published,
        "open": board.phase in now_open,
        "has_cross_play": phase.public and phase.cross_play_scenarios > 0,
    }
    fragment = render("board_table.html", **context)
    around = {"cut": Markup(_VISITOR_MARK), "board": Markup(fragment), "tab": context["tab"]}
    before, _, after = render("board.html", tabs=tabs, now_open=now_open, **around).partition(_VISITOR_MARK)
    anonymous = render("visitor.html", visitor=None, here="boards")
    return _RenderedBoard((before + anonymous + after).encode(), before.encode(), after.encode(), fragment.encode())


def _make_lines(session: Session, key: BoardKey, rows: Sequence[RowOut]) -> list[BoardLine]:
    ids = {team.name: team.id for team in teams.list_teams(session)}
    phase = phases.get(session, key.phase)
    exact = queries.find_score_histories(session, key.phase, key.track, [ids[row.team] for row in rows])
    histories = {team: [submission_views.visible_ds(phase, ds) for ds in scores] for team, scores in exact.items()}
    return [
        BoardLine(
            row,
            ids[row.team],
            charts.make_sparkline(histories.get(ids[row.team]) or [row.figures.ds]),
        )
        for row in rows
    ]


def _sort_value(row: RowOut, sort: str) -> Any:
    if sort in FiguresOut.model_fields:
        return getattr(row.figures, sort)
    if (column := SCALAR_BY_NAME.get(sort)) is not None:
        return column.find_value(row.figures)
    return row.created if sort == "date" else getattr(row, sort)


def _sort_key(row: RowOut, sort: str) -> tuple[bool, Any]:
    """Return a sort key that compares no unknown values."""
    value = _sort_value(row, sort)
    return value is not None, value.casefold() if isinstance(value, str) else value
