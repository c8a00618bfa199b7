"""What messages are worth to CoDriving: twins, budgets, and what a CAV sends."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from testing.study_samples import make_run, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scoring import Results, load_unchecked_results, save_results
from tools import codriving_values, write_published_tables
from tools.codriving_values import list_budget_table, list_message_gains, measure_budgets
from tools.published_values import read_values, write_values
from tools.write_published_tables import fill_page, load_values

PAGE = "<!-- values:cd:budgets:begin -->\n<!-- values:cd:budgets:end -->\n"


def drive(agent: str, ds: float, bytes_s: float | None = None, places: int = 12, **facts: object) -> Results:
    """A scenario of two CAVs on each place; the first half of the places is better by 4 DS."""
    ego = {"outcome": "arrived", "reason": "", "ds": ds, "rc": ds, "ip": 1.0, "infractions": ()}
    scalars = {} if bytes_s is None else {"message_rate": bytes_s}
    scenarios = [
        make_scenario(
            f"s{place}", ds + 4 * (place < 6), egos=[{"id": one, **ego} for one in "01"], scalars=scalars
        ).model_copy(update={"place": f"place{place}"})
        for place in range(places)
    ]
    return make_run(*scenarios, agent=agent, **facts)


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folders of three budgets and of the twin, which has one scenario less."""
    monkeypatch.setattr(write_published_tables, "load_results", load_unchecked_results)
    folder = tmp_path / "runs"
    for part, found in {
        "budget-300": drive("codriving", 70.0, 2000.0),
        "budget-2796": drive("codriving", 75.0, 25_000.0),
        "budget-11184": drive("codriving", 76.0, 100_000.0),
        "alone": drive("codriving:alone", 68.0, 0.0, places=11),
    }.items():
        (folder / part).mkdir(parents=True)
        save_results(found, folder / part / "results.json")
    return folder


def test_budgets_have_what_a_cav_sends_and_what_it_is_worth(runs: Path, tmp_path: Path) -> None:
    """25 kB a second of two CAVs are 100 kbit/s each; 11 scenarios of DS 75, of which six have 4 more."""
    path = tmp_path / "docs/results/values/cd.parquet"
    write_values(path, load_values([runs]))
    page = fill_page(PAGE, tmp_path, "page.md")
    assert "| 300 | 12 | 8.0 [8.0, 8.0] |" in page
    assert "| 2796 | 112 | 100.0 [100.0, 100.0] | 77.2 [" in page and "| +7.0 [+7.0, +7.0] |" in page
    assert page.index("| 300 |") < page.index("| 2796 |") < page.index("| 11184 |")
    assert "on the 11 scenarios that all runs have" in page and "Without messages DS is 70.2." in page
    content = path.read_bytes()
    write_values(path, read_values(path))
    assert path.read_bytes() == content


def test_the_curve_is_drawn(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(codriving_values, "VALUES_FOLDER", tmp_path)
    write_values(tmp_path / "cd.parquet", load_values([runs]))
    done = CliRunner().invoke(codriving_values.main, ["cd", str(tmp_path / "curve")])
    assert done.exit_code == 0, done.output
    assert b"11184 bytes" in (tmp_path / "curve.svg").read_bytes() and (tmp_path / "curve.png").is_file()


def test_budgets_that_cannot_be_compared_are_refused(runs: Path) -> None:
    values = load_values([runs])
    with pytest.raises(InputError, match="expected runs of 2 budgets or more, found 1"):
        measure_budgets({name: values[name] for name in ("alone", "budget-300")})
    other = make_run(make_scenario("elsewhere", 50.0), agent="codriving")
    with pytest.raises(InputError, match="expected scenarios that all runs have, found none"):
        list_budget_table({**values, "budget-700": [other]})
    with pytest.raises(InputError, match="table budgets: expected values of budgets, found values of single runs"):
        write_published_tables._format_runs("budgets", {"": [other]}, ())  # pyright: ignore[reportPrivateUsage]


def test_twins_are_compared_with_and_without_certificates(monkeypatch: pytest.MonkeyPatch) -> None:
    scenarios = [SimpleNamespace(id=f"s{place}") for place in range(12)]
    occluded = {f"s{place}": SimpleNamespace(occluded=place % 2 == 0) for place in range(11)}
    monkeypatch.setattr(codriving_values, "load_suite", lambda _: SimpleNamespace(scenarios=scenarios))
    monkeypatch.setattr(codriving_values.OcclusionCertificateFile, "load", lambda _: occluded)
    pair = [drive("codriving", 75.0), drive("codriving:alone", 70.0)]
    table, counted = list_message_gains(pair)
    assert "| codriving | all | 12 | 77.0 [" in table and "| +5.0 [+5.0, +5.0] |" in table
    assert "| codriving | with an occlusion certificate | 6 |" in table
    assert "| codriving | without one | 6 |" in table and "too few" in table
    assert counted == "" and "codriving:fast" not in table
    with pytest.raises(InputError, match="expected runs of codriving and codriving:alone, found no such pair"):
        list_message_gains(pair[:1])
    with pytest.raises(InputError, match="expected codriving with the same options in all runs, found others"):
        list_message_gains([*pair, drive("codriving", 75.0, agent_config="sha256:1")])
