"""Starts an uploaded agent in the process of a checker: the process that answers requests loads nothing for it."""

from pathlib import Path

from server.archive import Manifest
from server.settings import ServerSettings

AGENT_START_S = 60.0
"""Time limit of the call [s]: imports, unpacking, a box, and 20 s for the agent itself."""


def starts_agents(settings: ServerSettings) -> bool:
    """Return whether uploaded agents are started on this machine: only where agents of public phases run anyway."""
    work = settings.work
    return settings.limits.start_agents and work.processes > 0 and not work.scheduler and work.phase_kinds != "hidden"


def check_uploaded_agent(
    archive: Path, manifest: Manifest, settings: ServerSettings, sensor_track_only: bool = False
) -> bool:
    """Call `declaration_check.check_declaration`. Raises ArchiveRefused."""
    from server.evaluation.declaration_check import check_declaration

    return check_declaration(archive, manifest, settings, sensor_track_only=sensor_track_only)
