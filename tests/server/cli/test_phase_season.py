"""`admin phase draw`: a hidden phase with a season of its own. The drawing itself is tested with the generator."""

import stat
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.season_suites import write_season
from testing.worlds import straight_ego, straight_scenario

from mdrive_sumo.generate.seasons import draw_season as drawing
from mdrive_sumo.scenario.suite import Suite, load_suite
from server.cli import admin
from server.phase_suites import LoadedPhaseSuites
from server.settings import ServerSettings
from server.store.tables import PhaseRow

SETTINGS = """
[[phases]]
id = "final"
title = "Final"
suite = "{suite}"
public = {public}
opens = 2000-01-01T00:00:00Z
closes = 2099-02-01T00:00:00Z
"""


@pytest.fixture
def requests(monkeypatch: pytest.MonkeyPatch) -> list[drawing.SeasonRequest]:
    """Every season is one scenario of each part."""
    made: list[drawing.SeasonRequest] = []

    def draw(request: drawing.SeasonRequest, progress: object) -> list[Suite]:
        assert progress is not None
        made.append(request)
        whole = write_season(request.out, request.seed.season, straight_scenario(straight_ego("0")))
        return [*(load_suite(str(request.out / name)) for name in request.buckets), whole]

    monkeypatch.setattr(drawing, "draw_season", draw)
    return made


def call(tmp_path: Path, suite: Path | str, phase: str = "final", public: str = "false") -> Result:
    (tmp_path / "server.toml").write_text(SETTINGS.format(suite=suite, public=public))
    words = ("--settings", tmp_path / "server.toml", "--data", tmp_path / "data", "phase", "draw", phase)
    return CliRunner().invoke(admin, [str(word) for word in words])


def test_one_command_draws_the_season_of_a_phase(requests: list[drawing.SeasonRequest], tmp_path: Path) -> None:
    ended = call(tmp_path, tmp_path / "final" / "mdrive")
    assert ended.exit_code == 0, (ended.output, ended.exception)
    secret = tmp_path / "data" / "seasons" / "final"
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600 and len(secret.read_text()) > 40
    assert (requests[0].seed.season, requests[0].seed.secret) == ("final", secret.read_text().strip())
    assert requests[0].buckets == ["interdrive", "interaction", "v2xpnp"] and requests[0].out == tmp_path / "final"
    suite = load_suite(str(tmp_path / "final" / "mdrive"))
    assert f"mdrive@final, 3 scenarios, {suite.checksum()}" in ended.output
    assert secret.read_text().strip() not in ended.output
    row = PhaseRow(id="final", suite=str(suite.folder), public=True, seeds=2)
    assert len(LoadedPhaseSuites(ServerSettings(data=tmp_path / "data")).jobs(row)) == 6


def test_another_phase_has_another_secret_and_may_have_one_bucket(
    requests: list[drawing.SeasonRequest], tmp_path: Path
) -> None:
    assert call(tmp_path, tmp_path / "a" / "v2xpnp").exit_code == 0
    assert requests[0].buckets == ("v2xpnp",)
    again = call(tmp_path, tmp_path / "b" / "v2xpnp")
    assert again.exit_code == 0 and requests[1].seed == requests[0].seed, "the secret of a phase is kept"


@pytest.mark.parametrize(
    ("suite", "phase", "public", "sentence"),
    [
        ("/x/mdrive", "fnal", "false", "expected a phase of the settings (final), found 'fnal'"),
        ("/x/mdrive", "final", "true", "expected a hidden phase, found final, which is public: set public = false"),
        ("mdrive", "final", "false", "suite: expected an absolute folder FOLDER/mdrive or FOLDER/BUCKET"),
        ("/x/other", "final", "false", "found '/x/other'"),
        ("HERE/mdrive", "final", "false", "expected no folder"),
    ],
)
@pytest.mark.usefixtures("requests")
def test_bad_input_is_one_sentence(suite: str, phase: str, public: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "mdrive").mkdir()
    ended = call(tmp_path, suite.replace("HERE", str(tmp_path)), phase, public)
    assert sentence in f"{ended.output}{ended.exception}"
    assert ended.exit_code in (1, 2) and not (tmp_path / "data").exists()


@pytest.mark.usefixtures("requests")
def test_a_secret_that_is_too_short_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "data" / "seasons"
    folder.mkdir(parents=True)
    (folder / "final").write_text("short")
    ended = call(tmp_path, tmp_path / "final" / "mdrive")
    assert "expected a secret of 16 characters or more, found 5" in f"{ended.output}{ended.exception}"
