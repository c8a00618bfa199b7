"""An uploaded agent is started once in a box: what its sensors are is known before it is in the queue."""

from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import patch

import pytest
from testing import evaluation_fakes
from testing.archive_samples import declaring, packed
from testing.sandbox_runs import needs_bubblewrap
from testing.small_environment import describe_small_environment

from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure
from server.archive import ArchiveLimits, ArchiveRefused, inspect_archive
from server.evaluation import declaration_check
from server.evaluation.declaration_check import check_declaration
from server.evaluation.phase_separation import PhaseSeparation
from server.settings import ServerSettings

Check = Callable[..., bool]


@pytest.fixture
def check(tmp_path: Path) -> Iterator[Check]:
    """Upload an agent with these sensors to a server that may start boxes; afterwards nothing of it is left."""
    settings = ServerSettings(data=tmp_path, sandbox=evaluation_fakes.SHARED)

    def run(sensors: str = "", made: str = "pass", environment: bool = True, sensor_track_only: bool = False) -> bool:
        about = settings.environments / "python3.11-numpy"
        if environment and not about.exists():
            about.mkdir(parents=True)
            describe_small_environment(about)
        archive = tmp_path / "upload.part"
        source = declaring(sensors, made=made)
        archive.write_bytes(
            packed({"agents.py": source.encode(), "model_env.yaml": b"environment: python3.11-numpy\n"})
        )
        manifest = inspect_archive(archive, ArchiveLimits())
        return check_declaration(archive, manifest, settings, sensor_track_only=sensor_track_only)

    yield run
    stage = tmp_path / "stage"
    assert not stage.exists() or list(stage.iterdir()) == []


@pytest.mark.slow
@needs_bubblewrap
def test_sensors_are_refused_and_good_agents_are_not(check: Check) -> None:
    """In a real box; which sensors there are to be refused is `check`'s, in the tests of participants."""
    assert check("SensorSpec('objects'),")
    with pytest.raises(ArchiveRefused, match="found another name of a camera"):
        check("SensorSpec('rgb'),")
    lists = "SensorSpec('lidar', options={'hit_ids': True}),"
    with pytest.raises(ArchiveRefused, match="sensor 'lidar' with hit_ids: expected sensors of the sensor track"):
        check(lists, sensor_track_only=True)


def test_nothing_is_started_beside_jobs_of_a_hidden_phase(check: Check, tmp_path: Path) -> None:
    """A refusal quotes the agent, so nothing of a hidden scenario may reach it."""
    hidden = PhaseSeparation("hidden", tmp_path, drop_caches=False)
    assert hidden.try_begin("job", public=False, now_us=0)
    with patch.object(declaration_check, "read_declaration", side_effect=AssertionError):
        assert check("SensorSpec('rgb'),") is False
        hidden.close()
        with pytest.raises(AssertionError):
            check()
    assert hidden.try_begin("next", public=False, now_us=0)  # no mark is left behind
    hidden.close()


@pytest.mark.parametrize("failure", [AgentFailure(FailureReason.TIMEOUT, "late"), OSError("disk full")])
def test_what_is_no_refusal_of_sensors_leaves_the_upload_as_it_was(check: Check, failure: Exception) -> None:
    with patch.object(declaration_check, "read_declaration", side_effect=failure):
        assert check() is False


def test_an_environment_that_cannot_be_read_is_the_workers_to_report(check: Check) -> None:
    assert check(environment=False) is False
