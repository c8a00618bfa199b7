"""Files of every format since 0.2.0 are read: tests/kept_formats holds one file of each, which no change may rewrite.

A new version of a format adds a file beside that of the version before. They were written by mdrive-sumo itself: `run`
by `eval --agent sharing --comm realistic` on 8 m of i11_ins_sl_town (testing.short_suite), `open_loop.json` by
`eval-open` on that run, `dataset.json` by `learn data` on that suite, `suite` by `convert v2xpnp` from
testing.small_log, `human_study` with the plan of testing.human_study; `databases` is the SQL text of a server's SQLite
file after each migration, with a team and its finished submission (testing.store_samples), `archive.zip` the good one
of testing.archive_samples; the others are entries of packaged suites and weights.
"""

import json
import re
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from testing.paths import ROOT, TESTS

from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.onnx_manifest import read_manifest
from mdrive_sumo.episode import load_episode
from mdrive_sumo.generate.hard.hard_recipe import HardRecipe
from mdrive_sumo.generate.recipe import load_recipe
from mdrive_sumo.learning.shard_reading import load_dataset_file
from mdrive_sumo.open_loop.results import OpenLoopResults
from mdrive_sumo.roads import load_road_map
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.runs.journal import read_run_journal
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.reference_times import read_reference_times
from mdrive_sumo.scenario.scenario import load_model, load_scenario
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import load_results
from mdrive_sumo.study.human.human_study_folder import HumanStudyFolder
from mdrive_sumo.study.need_certificate import NeedCertificateFile
from mdrive_sumo.study.occlusion_certificate import OcclusionCertificateFile
from mdrive_sumo.worlds.places import read_place
from real2sim.pipeline.quality_file import load_quality
from server.archive import ArchiveLimits, check_archive
from server.enums import SubmissionState
from server.store import Store, audit
from server.store.row_check import find_row_differences
from server.store.tables import SubmissionRow, TeamRow

KEPT = TESTS / "kept_formats"
RECORDING = "i11_ins_sl_town.npz"


def read_journal(folder: Path) -> tuple[str, float]:
    """Return the agent of a run, and the driving score of its only episode."""
    fingerprint, journal = read_run_journal(folder)
    (result,) = journal.results
    return RunConfig.from_dict(fingerprint).agent.name, result["ds"]


def read_answers(folder: Path) -> object:
    """Return what the first participant of a study answered after the first drive."""
    return HumanStudyFolder.open_existing(folder).load_progress("P01").drives[0].answers


READERS: Mapping[str, tuple[Callable[[], Any], Any]] = {
    "results/4": (lambda: load_results(KEPT / "run/results.json").overall.bucket_mean.ds, 100.0),
    "journal/2": (lambda: read_journal(KEPT / "run"), ("sharing", 100.0)),
    "episode/3": (lambda: load_episode(KEPT / "run/episodes" / RECORDING).ticks, 88),
    "open-loop/1": (lambda: len(load_model(KEPT / "open_loop.json", OpenLoopResults).scenarios), 1),
    "training-data/1": (lambda: load_dataset_file(KEPT).samples, 53),
    "suite/1": (lambda: load_suite(str(KEPT / "suite")).name, "suite"),
    "scenario/1": (lambda: len(load_scenario(KEPT / "suite/small/scenario.json").background.vehicles), 2),
    "network/1": (lambda: read_network_file(KEPT / "suite/networks/small").name, "small"),
    "place/1": (lambda: read_place(KEPT).name, "side_street"),
    "quality/1": (lambda: load_quality(KEPT / "suite/small/quality.json").by_sumo, 2),
    "recipe/1": (lambda: load_recipe(KEPT / "recipe.json").id, "construction_03"),
    "hard-recipe/2": (
        lambda: HardRecipe.model_validate_json(read_bytes(KEPT / "hard_recipe.json")).place.kind,
        "crossing",
    ),
    "reference-times/1": (lambda: len(read_reference_times(KEPT).scenarios), 1),  # pyright: ignore[reportOptionalMemberAccess]
    "need/1": (lambda: len(NeedCertificateFile.read(KEPT).certificates), 1),  # pyright: ignore[reportOptionalMemberAccess]
    "need/2": (lambda: str(NeedCertificateFile.read(KEPT / "need_2").certificates[0].proves), "all"),  # pyright: ignore[reportOptionalMemberAccess]
    "human-study/1": (lambda: HumanStudyFolder.open_existing(KEPT / "human_study").drivers, "persons"),
    "human-study-plan/1": (lambda: HumanStudyFolder.open_existing(KEPT / "human_study").plan.title, "A small study"),
    "human-study-progress/1": (lambda: read_answers(KEPT / "human_study"), {"safe": 6.0}),
    "occlusion/1": (lambda: len(OcclusionCertificateFile.read(KEPT).certificates), 1),  # pyright: ignore[reportOptionalMemberAccess]
}
"""By format: what reads the example, and one thing that it says."""
NOT_KEPT = {
    **dict.fromkeys(
        (
            *("ablation/1", "attacks/1", "channel-study/1", "study/1", "paper/1", "gain/1"),
            *("cross-play/1", "penetration/1", "seasons/1", "twins/1", "detectors/1"),
        ),
        "written only",
    ),
    **dict.fromkeys(("networks/1", "conversion/1"), "written only"),
    **dict.fromkeys(("hard-search/5", "paper-plan/1"), "goes on with the version that began"),
    "hard-recipe/1": "its families are gone: rebuilding hard@0 says so",
    "contract/3": "no file: what crosses the border to an agent",
}
"""Formats without an example, and why."""


@pytest.mark.parametrize("name", READERS)
def test_a_kept_file_is_read(name: str) -> None:
    read, said = READERS[name]
    assert read() == said


def test_weights_are_read() -> None:
    assert read_manifest(KEPT / "weights.json", WeightsManifest).system == "tcp"


def test_a_recorded_log_is_read() -> None:
    assert load_episode(KEPT / "suite/small/log.npz").scenario == "small"
    assert load_road_map(KEPT / "suite/networks/small").driving


def list_migrations() -> set[str]:
    return {path.stem for path in (ROOT / "server/store/migrations/versions").glob("*.py")}


def test_every_migration_has_a_database() -> None:
    assert {path.stem for path in (KEPT / "databases").iterdir()} == list_migrations()


@pytest.mark.parametrize("name", sorted(list_migrations()))
def test_a_kept_database_is_migrated(name: str, tmp_path: Path) -> None:
    file = tmp_path / "kept.sqlite"
    with closing(sqlite3.connect(file)) as connection:
        connection.executescript((KEPT / "databases" / f"{name}.sql").read_text())
    store, newest = Store(f"sqlite:///{file}"), Store(f"sqlite:///{tmp_path / 'new.sqlite'}")
    with closing(store), closing(newest):
        store.migrate()
        newest.migrate()
        store.check(whole=True)
        assert store.version() == newest.version()
        with store.read() as session:
            assert [team.name for team in session.query(TeamRow)] == ["Kept"]
            [submission] = session.query(SubmissionRow)
            assert (submission.state, submission.ds) == (SubmissionState.DONE, 80.0)
            assert audit.verify_chain(session).broken is None
            assert list(find_row_differences(session)) == []
            assert check_archive(KEPT / "archive.zip", ArchiveLimits()).sha256 == submission.archive_sha256


def test_every_format_has_an_example_or_a_reason() -> None:
    sources = [path for room in ("mdrive_sumo", "real2sim") for path in (ROOT / room).rglob("*.py")]
    stated = {found for path in sources for found in re.findall(r'"mdrive-sumo/([a-z-]+/\d+)"', path.read_text())}
    assert stated == READERS.keys() | NOT_KEPT.keys()


def test_an_example_states_the_format_that_its_test_names() -> None:
    """Files are examples of their own version, also when a newer one is written."""
    texts = [path.read_text() for path in KEPT.rglob("*.json*")]
    stated = {found for text in texts for found in re.findall(r'"mdrive-sumo/([a-z-]+/\d+)"', text)}
    assert stated | {"episode/3"} == READERS.keys()
    assert json.loads(read_bytes(KEPT / "weights.json"))["format_version"] == 1
