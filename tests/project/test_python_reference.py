"""The generated Python reference shows everything that a user's code touches: names, fields, signatures."""

import re
from dataclasses import fields, is_dataclass
from typing import get_type_hints

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config
from testing.paths import ROOT

import mdrive_sumo as md
from mdrive_sumo import contract

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of the site, built alone: its links to other pages are removed."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "docs").mkdir()
    text = (ROOT / "docs" / "python.md").read_text("utf-8")
    (folder / "docs" / "python.md").write_text(re.sub(r"\]\([^)]*\)", "]", text), "utf-8")
    config = load_config(
        str(ROOT / "mkdocs.yml"), docs_dir=str(folder / "docs"), site_dir=str(folder / "site"), nav=[{"P": "python.md"}]
    )
    build(config)
    return (folder / "site" / "python.html").read_text("utf-8")


def list_exchanged_types() -> list[type]:
    """Every dataclass that an agent is given or gives, and those of their fields."""
    found: list[type] = []
    queue: list[object] = [contract.SensorSpec, contract.Briefing, contract.Observation, contract.Reply]
    while queue:
        kind = queue.pop()
        queue += getattr(kind, "__args__", ())
        if isinstance(kind, type) and is_dataclass(kind) and kind not in found:
            found.append(kind)
            queue += get_type_hints(kind).values()
    return found


def test_every_name_of_the_front_door_has_an_entry(page: str) -> None:
    entries = {path.rpartition(".")[2] for path in re.findall(r'id="(mdrive_sumo\.[\w.]+)"', page)}
    assert set(md.__all__) - entries == set()


@pytest.mark.parametrize("kind", list_exchanged_types(), ids=lambda kind: kind.__name__)
def test_every_exchanged_field_is_described(page: str, kind: type) -> None:
    base = f"mdrive_sumo.contract.{kind.__name__}"
    for field in fields(kind):
        found = re.search(
            rf'id="{re.escape(f"{base}.{field.name}")}".*?<div class="doc doc-contents ">(.*?)</div>', page, re.S
        )
        assert found, f"{base}.{field.name}: no entry"
        assert re.sub(r"<[^>]+>", "", found[1]).strip(), f"{base}.{field.name}: no text"


def test_constructors_have_signatures(page: str) -> None:
    for name in ("Plan", "Control", "Reply", "SensorSpec", "Message", "OwnState"):
        after = page.partition(f'id="mdrive_sumo.contract.{name}"')[2]
        signature = re.sub(r"<[^>]+>", "", after.partition("</pre>")[0])
        for field in fields(getattr(contract, name)):
            assert re.search(rf"\b{field.name}\b", signature), (name, field.name, signature[:300])
