"""Add the web pages to the application of the API."""

from functools import partial

from fastapi import APIRouter, Depends, FastAPI

from server.web import (
    admin_pages,
    guide_page,
    leaderboard_page,
    login_pages,
    overview_pages,
    scenario_page,
    static_files,
    submission_page,
    submit_page,
    team_page,
)
from server.web.templating import render_error
from server.web.visitor import check_same_site


def mount_pages(app: FastAPI) -> None:
    """Add the pages to an application of `server.api.create_app`; outside /api its errors become pages, too."""
    connect_pages(app)
    pages = APIRouter(include_in_schema=False, dependencies=[Depends(check_same_site)])
    for part in (
        static_files,
        leaderboard_page,
        login_pages,
        guide_page,
        submit_page,
        submission_page,
        scenario_page,
        overview_pages,
        team_page,
        admin_pages,
    ):
        pages.include_router(part.router)
    app.include_router(pages)


def connect_pages(app: FastAPI) -> None:
    """Let the services of an application with pages build the leaderboard, and its errors become pages."""
    app.state.error_page = render_error
    app.state.services.leaderboards.add_builder(partial(leaderboard_page.build_page, app.state.services))
