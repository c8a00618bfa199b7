"""Which phase the form and the commands propose."""

from dataclasses import replace
from pathlib import Path

import pytest
from testing.api_app import HIDDEN, Server
from testing.store_samples import NOON, PHASE
from testing.web_page import Page, Visit

from server.store import phases

pytestmark = pytest.mark.slow


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path / "data")


@pytest.fixture
def red(server: Server) -> Visit:
    return Visit(server, "red")


def selected(page: Page) -> list[str]:
    """Values of the chosen options of a form, its first one if none is."""
    options = page.all("option")
    return [each.attributes["value"] for each in options if "selected" in each.attributes] or [
        options[0].attributes["value"]
    ]


def test_a_hidden_phase_is_never_the_default(server: Server, red: Visit) -> None:
    """It is the first by its opening time and its id, and its quota is used up by one careless submission."""
    hidden = replace(HIDDEN, id="a-final", opens_us=0)
    with server.store.write() as session:
        phases.set_phases(session, [hidden], NOON)
    assert selected(red.get("/submit")) == ["dev"]
    assert selected(red.get("/submit?phase=a-final")) == ["a-final"]
    commands = red.get("/how").words
    assert "--phase dev " in commands and "-F phase=dev " in commands
    with server.store.write() as session:
        phases.set_phases(session, [replace(PHASE, closes_us=1)], NOON)
    page = red.get("/submit")
    assert selected(page) == [""] and page.all("select", id="phase")[0].attributes["required"] == ""
    assert "--phase PHASE " in red.get("/how").words
