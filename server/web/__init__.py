"""The pages of the challenge: HTML made here, for people; programs use the API."""

from functools import partial

from fastapi import APIRouter, Depends, FastAPI

from server.web import admin, assets, board, entry, errors, how, scenarios, submission, submitting, team
from server.web.visitors import same_site


def mount(app: FastAPI) -> None:
    """Adds the pages to an application of `server.api.create_app`; outside /api its errors are pages, too."""
    app.state.error_page = errors.page_of
    app.state.tools.boards.also(partial(board.make, app.state.tools))
    pages = APIRouter(include_in_schema=False, dependencies=[Depends(same_site)])
    for part in (assets, board, entry, how, submitting, submission, scenarios, team, admin):
        pages.include_router(part.router)
    app.include_router(pages)


__all__ = ["mount"]
