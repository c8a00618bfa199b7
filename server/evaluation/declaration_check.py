"""Starts an uploaded agent once in a sandbox: what it declares is refused at upload and not in the queue."""

import logging
import tempfile
from dataclasses import replace
from pathlib import Path

from mdrive_sumo.agent_process.reply_decoding import AgentDeclaration
from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.loop.agent_driver import AgentFailure
from server.archive import ArchiveRefused, Manifest, extract_archive
from server.clock import now_us
from server.environments import load_environment
from server.evaluation.machine_check import find_layers
from server.evaluation.phase_separation import PhaseSeparation
from server.settings import ServerSettings
from server.submitted_agent import SubmittedAgent, read_declaration
from server.tracks import check_sensing

LOG = logging.getLogger("mdrive.upload")
START_S = 20.0
"""Time limit of the start [s], shorter than in an episode: a checker is occupied meanwhile."""


def check_declaration(
    archive: Path, manifest: Manifest, settings: ServerSettings, *, sensor_track_only: bool = False
) -> bool:
    """Start the agent of a checked archive and check its sensors; return whether that could be done now.

    It cannot while jobs of a hidden phase run on this host: the sentence of a refusal quotes the agent, so its sandbox
    must find none of theirs beside it (`phase_separation`). An agent that cannot be created is not refused: that is a
    result. Whatever is not found here is found when the first job starts. Needs the main thread.

    Raises ArchiveRefused for a sensor that does not exist or is not allowed, also in a phase of the sensor track only,
    and for sensors over the budget.
    """
    separation = PhaseSeparation("public", settings.data, drop_caches=False)
    try:
        environment = load_environment(manifest.environment, settings.environments)
        backend = settings.sandbox.choose_backend()
        find_layers(settings.sandbox.required, backend, settings.sandbox.copies)
        if not separation.try_begin("upload", public=True, now_us=now_us()):
            return False
        stage = settings.data / "stage"  # where folders that a crash leaves are deleted
        make_folder(stage)
        with tempfile.TemporaryDirectory(prefix="upload.", dir=stage) as scratch:
            folder = Path(scratch)
            folder.chmod(0o755)  # sandboxes run as other users
            extract_archive(archive, manifest, folder / "agent")
            sandbox = settings.sandbox
            line = sandbox.line_limits()
            declared = read_declaration(
                SubmittedAgent(
                    manifest,
                    folder / "agent",
                    environment,
                    sandbox.box_limits(),
                    replace(line, start_s=min(line.start_s, START_S)),
                    backend,
                    sandbox.copies_folder(),
                )
            )
        refuse_sensing(declared, sensor_track_only=sensor_track_only)
    except AgentFailure:
        return False
    except ArchiveRefused:
        raise
    except (InputError, WorldError, OSError) as error:
        LOG.warning("an uploaded agent was not started: %s", error)
        return False
    finally:
        separation.close()
    return True


def refuse_sensing(declared: AgentDeclaration, *, sensor_track_only: bool) -> None:
    """Raise ArchiveRefused for a sensor that lists objects in a phase of the sensor track."""
    try:
        check_sensing(declared.sensors, sensor_track_only=sensor_track_only)
    except InputError as error:
        raise ArchiveRefused(str(error)) from None
