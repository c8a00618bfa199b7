"""Pages of a study: the participant's next step, and the organiser's overview."""

from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from http import HTTPStatus
from importlib.resources import files
from typing import Annotated

from fastapi import APIRouter, Depends, FastAPI, Request, Response
from fastapi.responses import HTMLResponse, JSONResponse, RedirectResponse
from jinja2 import Environment, PackageLoader, StrictUndefined

from mdrive_sumo.core.clean_text import clean_for_page
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.study.human.participant_progress import ParticipantProgress, StepKind, StudyStep
from server.drive.drive_app import HEADERS, POLICY, DriveRefusal
from server.drive.study.questionnaire_form import FormAnswers
from server.drive.study.study_service import STUDY_PATH, StudyService, WrongStep

MAX_FORM_BYTES = 1_000_000
"""Of a questionnaire: 60 texts of 4000 characters, each encoded in up to three bytes, are 720 kB."""
MAX_FORM_FIELDS = 200
STATIC_KINDS = {"study.css": "text/css", "study.js": "text/javascript"}
NO_LINK = "this link is not valid; ask the organiser of the study for yours"
NO_ANSWERS = FormAnswers({}, {})
STUDY_HEADERS = {
    **HEADERS,
    "Content-Security-Policy": POLICY.replace("form-action 'none'", "form-action 'self'"),
    "Cache-Control": "no-store",
}
TEMPLATES: Mapping[StepKind, str] = {
    StepKind.CONSENT: "consent.html",
    StepKind.PRACTICE: "next_drive.html",
    StepKind.DRIVE: "next_drive.html",
    StepKind.DRIVING: "driving.html",
    StepKind.QUESTIONS: "questions.html",
    StepKind.BREAK: "break.html",
    StepKind.END_QUESTIONS: "questions.html",
    StepKind.THANKS: "thanks.html",
}
router = APIRouter(include_in_schema=False)


def format_moment(at: int) -> str:
    """Return a time in seconds since 1970 as 2026-01-31 12:00 UTC."""
    return f"{datetime.fromtimestamp(at, UTC):%Y-%m-%d %H:%M} UTC"


def _make_environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("server.drive.study"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=clean_for_page,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["moment"] = format_moment
    return environment


_environment = _make_environment()


def mount_study(app: FastAPI, service: StudyService) -> None:
    """Add the pages of a study to the application of drives."""
    app.state.study = service
    app.include_router(router)


def _get_service(request: Request) -> StudyService:
    return request.app.state.study


ServiceDep = Annotated[StudyService, Depends(_get_service)]


def require_participant(service: ServiceDep, token: str = "") -> str:
    """Return the code of the participant whose link this is. Raises DriveRefusal."""
    code = service.find_code(token)
    if code is None:
        raise DriveRefusal(HTTPStatus.FORBIDDEN, NO_LINK)
    return code


ParticipantDep = Annotated[str, Depends(require_participant)]


def require_organiser(service: ServiceDep, token: str = "") -> None:
    """Raise DriveRefusal unless the link is the organiser's."""
    if not service.is_organiser(token):
        raise DriveRefusal(
            HTTPStatus.FORBIDDEN, "expected the organiser's link, which the server printed, found another"
        )


def _render(template: str, service: StudyService, status: int = HTTPStatus.OK, **context: object) -> HTMLResponse:
    text = _environment.get_template(template).render(plan=service.study.plan, **context)
    return HTMLResponse(text, status, headers=STUDY_HEADERS)


# -------------------------------------------------------------------------------------------------------- participants


@router.get(STUDY_PATH)
async def show_step(service: ServiceDep, code: ParticipantDep, token: str = "") -> Response:
    """Show the participant's next step."""
    if service.has_withdrawn(code):
        return _render("withdrawn.html", service)
    progress, step = await service.find_step(code)
    return _show(service, progress, step, token)


def _show(
    service: StudyService,
    progress: ParticipantProgress,
    step: StudyStep,
    token: str,
    given: FormAnswers = NO_ANSWERS,
    form: Mapping[str, object] | None = None,
) -> HTMLResponse:
    status = HTTPStatus.UNPROCESSABLE_ENTITY if given.problems else HTTPStatus.OK
    return _render(
        TEMPLATES[step.kind],
        service,
        status,
        code=progress.code,
        step=step,
        token=token,
        questions=service.list_questions(step),
        problems=given.problems,
        form=form or {},
        practised=len(progress.list_drives("practice")),
    )


@router.get(f"{STUDY_PATH}/step")
async def tell_step(service: ServiceDep, code: ParticipantDep) -> Response:
    """Tell a page that waits whether the next step is another one."""
    if service.has_withdrawn(code):
        return JSONResponse({"step": "withdrawn", "drives": 0}, headers=STUDY_HEADERS)
    progress, step = await service.find_step(code)
    return JSONResponse({"step": step.kind, "drives": len(progress.drives)}, headers=STUDY_HEADERS)


@router.post(f"{STUDY_PATH}/consent")
async def consent(request: Request, service: ServiceDep, code: ParticipantDep) -> Response:
    """Note the consent."""
    form = await _read_form(request)
    if form.get("agree") != "yes":
        raise InputError("consent: expected the box to be ticked, found it empty; without consent nothing begins")
    return await _go_on(service, code, service.consent)


@router.post(f"{STUDY_PATH}/drive")
async def open_drive(service: ServiceDep, code: ParticipantDep) -> Response:
    """Begin or continue a drive, and go to its page."""
    _require_present(service, code)
    try:
        path = await service.open_drive(code)
    except WrongStep:
        path = service.make_path(code)
    return RedirectResponse(path, HTTPStatus.SEE_OTHER, headers=STUDY_HEADERS)


@router.post(f"{STUDY_PATH}/give-up")
async def give_up(service: ServiceDep, code: ParticipantDep) -> Response:
    """End the open drive early."""
    return await _go_on(service, code, service.give_up)


@router.post(f"{STUDY_PATH}/answers")
async def answer(request: Request, service: ServiceDep, code: ParticipantDep, token: str = "") -> Response:
    """Keep the answers of a questionnaire, or show it again with what is wrong."""
    _require_present(service, code)
    form = await _read_form(request)
    try:
        given = await service.answer(code, form)
    except WrongStep:
        given = NO_ANSWERS
    if given.problems:
        progress, step = await service.find_step(code)
        return _show(service, progress, step, token, given, form)
    return RedirectResponse(service.make_path(code), HTTPStatus.SEE_OTHER, headers=STUDY_HEADERS)


@router.get(f"{STUDY_PATH}/withdraw")
async def ask_withdrawal(service: ServiceDep, code: ParticipantDep, token: str = "") -> Response:
    """Ask whether everything shall be deleted."""
    if service.has_withdrawn(code):
        return _render("withdrawn.html", service)
    return _render("withdraw.html", service, code=code, token=token)


@router.post(f"{STUDY_PATH}/withdraw")
async def withdraw(service: ServiceDep, code: ParticipantDep) -> Response:
    """Delete everything of the participant."""
    await service.withdraw(code)
    return RedirectResponse(service.make_path(code), HTTPStatus.SEE_OTHER, headers=STUDY_HEADERS)


def _require_present(service: StudyService, code: str) -> None:
    if service.has_withdrawn(code):
        raise DriveRefusal(HTTPStatus.GONE, "you have withdrawn from the study; nothing of you is kept")


async def _go_on(service: StudyService, code: str, do_step: Callable[[str], Awaitable[None]]) -> Response:
    """Do a step and show the next one; a form of a step that is over changes nothing."""
    _require_present(service, code)
    with suppress(WrongStep):
        await do_step(code)
    return RedirectResponse(service.make_path(code), HTTPStatus.SEE_OTHER, headers=STUDY_HEADERS)


async def _read_form(request: Request) -> Mapping[str, object]:
    size = request.headers.get("content-length", "")
    if not size.isdigit() or int(size) > MAX_FORM_BYTES:
        raise DriveRefusal(
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected a form of at most {MAX_FORM_BYTES} bytes, found more"
        )
    form = await request.form(max_files=0, max_fields=MAX_FORM_FIELDS)
    return {name: value for name, value in form.items() if isinstance(value, str)}


# ----------------------------------------------------------------------------------------------------------- organiser


@router.get(f"{STUDY_PATH}/overview", dependencies=[Depends(require_organiser)])
async def show_overview(service: ServiceDep) -> Response:
    """Show how far every participant is, with the links to give to them."""
    return _render("overview.html", service, rows=service.list_participants(), folder=str(service.study.folder))


@router.get(f"{STUDY_PATH}/static/{{name}}")
async def send_static(name: str) -> Response:
    """Return the style sheet or the script of the pages."""
    if name not in STATIC_KINDS:
        raise DriveRefusal(HTTPStatus.NOT_FOUND, f"there is nothing at {STUDY_PATH}/static/{name:.60}")
    content = files("server.drive.study").joinpath("static", name).read_bytes()
    return Response(content, media_type=STATIC_KINDS[name], headers={**STUDY_HEADERS, "Cache-Control": "no-cache"})
