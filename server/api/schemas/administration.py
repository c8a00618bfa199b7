"""Response bodies of the state of the server and of the audit log."""

from pydantic import Field

from server.api.schemas.parameters import ResponseModel


class HealthOut(ResponseModel):
    """The server and its database answer."""

    status: str
    version: str


class AuditOut(ResponseModel):
    """Result of verifying the audit log's hash chain."""

    entries: int
    head: str
    broken: int | None
    """Id of the first entry whose hash does not fit the one before; null if all fit."""
    differences: list[str] = Field(default=[])
    """Rows that are not as the log says, at most 100; empty if the chain is broken."""
