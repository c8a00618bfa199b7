"""Accepts submissions."""

from typing import Annotated, Any

from fastapi import APIRouter, Header, Request

from server.api.dependencies import Now, ServicesDep, TeamCaller
from server.api.problems import document_problems
from server.api.schemas.submissions import SubmissionOut
from server.api.submission_service import receive_submission
from server.api.upload import FILE_FIELD
from server.enums import ChallengeTrack

router = APIRouter(tags=["submissions"])
_FORM: dict[str, Any] = {
    "required": True,
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["phase", "track", "name", FILE_FIELD],
                "additionalProperties": False,
                "properties": {
                    "phase": {"type": "string", "minLength": 1, "maxLength": 40, "description": "Id of the phase."},
                    "track": {"type": "string", "enum": [track.value for track in ChallengeTrack]},
                    "name": {"type": "string", "minLength": 1, "maxLength": 80, "description": "Name of your method."},
                    FILE_FIELD: {"type": "string", "format": "binary", "description": "The zip file."},
                },
            }
        }
    },
}
IdempotencyKey = Annotated[
    str | None,
    Header(
        max_length=80, description="A repeated key returns the same submission, so a request can be sent twice safely."
    ),
]


@router.post(
    "/submissions",
    status_code=201,
    responses=document_problems(400, 401, 403, 404, 408, 409, 413, 415, 422, 429),
    openapi_extra={"requestBody": _FORM},
)
async def submit(
    request: Request, caller: TeamCaller, services: ServicesDep, at_us: Now, idempotency_key: IdempotencyKey = None
) -> SubmissionOut:
    """Submit an archive. The response comes at once, the result later: follow the events.

    The same archive in the same phase and track returns the finished result and uses no quota.
    """
    return await receive_submission(request, services, caller, idempotency_key, at_us)
