"""`import mdrive_sumo` offers the public names and loads them on first use."""

import subprocess
import sys
import tomllib

import pytest
from testing.paths import ROOT

import mdrive_sumo as md
from mdrive_sumo.scenario.suite import load_suite


def test_every_public_name_can_be_imported() -> None:
    assert {name for name in md.__all__ if getattr(md, name, None) is None} == set()
    assert set(md.__all__) <= set(dir(md))
    assert md.load_suite is load_suite


def test_a_release_changes_one_variable() -> None:
    """The package has the version of `__version__`; the citation says the same."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert (
        "version" not in project["project"]
        and project["tool"]["hatch"]["version"]["path"] == "mdrive_sumo/core/version.py"
    )
    assert f"\nversion: {md.__version__}\n" in (ROOT / "CITATION.cff").read_text()


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        md.simulat  # noqa: B018


def test_the_import_loads_no_other_package() -> None:
    """Child processes of agents and `mdrive-sumo --help` pay for what this import loads."""
    heavy = ("numpy", "pandas", "pydantic", "libsumo", "matplotlib", "mdrive_sumo.api")
    code = f"import sys, mdrive_sumo; print([name for name in {heavy!r} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_all_errors_have_one_base() -> None:
    assert all(issubclass(error, md.MdriveError) for error in (md.InputError, md.WorldError, md.AgentFailure))


def test_a_suite_is_a_list_with_globs() -> None:
    suite = md.load_suite("interdrive@0")
    part = suite["i1[12]*"]
    assert isinstance(part, md.Suite)
    assert [scenario.id for scenario in part] == ["i11_ins_sl_town", "i12_ins_sl_old_town"]
    assert suite["i11_ins_sl_town"] is part[0] is suite[10]
    assert len(suite[:3]) == 3 and len(suite["i11*,hw_c"]) == 1 + len(suite["hw_c"])
    with pytest.raises(md.InputError, match="expected a scenario id or category like 'nothing'"):
        suite["nothing"]


@pytest.mark.slow
def test_a_suite_as_a_frame_has_one_row_per_scenario() -> None:
    frame = md.load_suite("interdrive@0").to_frame()
    assert len(frame) == 46 and frame.cavs.sum() == 175
    assert frame.loc["i11_ins_sl_town", "category"] == "ins_sl"


def test_without_pandas_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(md.InputError, match=r"pip install '\.\[notebook\]'"):
        md.load_suite("interdrive@0").to_frame()


def test_packaged_suites_are_listed() -> None:
    assert "interdrive" in md.list_suites()


def test_what_a_notebook_echoes_fits_on_the_screen() -> None:
    suite = md.load_suite("interdrive@0")
    assert repr(suite) == "Suite('interdrive@0', 46 scenarios)"
    assert repr(suite["i11_ins_sl_town"]) == "Scenario('i11_ins_sl_town', InterDrive, ins_sl, 3 CAVs, 0 actors)"
