"""What others have written does nothing on a terminal, in a spreadsheet, in Markdown, on a page or in a log."""

import logging
import pickle
import re
import unicodedata

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from mdrive_sumo.cli.command_line import InputProblem
from mdrive_sumo.core.clean_text import (
    clean_for_csv,
    clean_for_markdown,
    clean_for_page,
    clean_for_terminal,
    clean_line,
    format_markdown_code,
)
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_csv_lines, format_markdown, format_text, make_text_table
from mdrive_sumo.core.terminal import CleanFormatter, echo
from mdrive_sumo.report.html_page import PAGE_TEMPLATES

ESCAPES = "\x1b]0;owned\x07\x1b[2J\x9b31m\r"
BIDI = "\u202egnp.\u2066exe\u200f\u061c"
HONEST = "idm, omniscient [privileged, object track], Zoë's agent.py:Driver × ≥ 80 % – 王 🚗 a_b*c"


@pytest.mark.parametrize("text", [ESCAPES, BIDI, "a\u2028b", "\x00", "\ud800"])
def test_a_terminal_is_told_nothing(text: str) -> None:
    for clean in (clean_for_terminal, clean_line, clean_for_csv, clean_for_markdown, clean_for_page):
        shown = clean(text)
        assert isinstance(shown, str)
        assert all(unicodedata.category(character) not in ("Cc", "Cf", "Cs", "Zl") for character in shown)
    assert clean_line("a\x1b[2J\n\u202e") == r"a\x1b[2J\n\u202e"


def test_a_refusal_is_one_line_whatever_it_quotes() -> None:
    class OneOfMany(InputError): ...

    for kind in (InputError, OneOfMany):
        error = kind("a.pkl: found the class numpy._\nore\x1b[2J, expected Zoë's")
        assert str(error) == r"a.pkl: found the class numpy._\nore\x1b[2J, expected Zoë's"
        assert str(pickle.loads(pickle.dumps(error)) if kind is InputError else kind(str(error))) == str(error)


@pytest.mark.parametrize("clean", [clean_for_terminal, clean_line, clean_for_csv, clean_for_markdown, clean_for_page])
def test_honest_text_stays_as_it_is(clean: object) -> None:
    assert callable(clean)
    assert clean(HONEST) == HONEST


def test_lines_stay_where_they_are_meant() -> None:
    assert clean_for_terminal("a\n\tb") == "a\n\tb"
    assert (
        format_text(make_text_table(("agent", "DS"), [("a\nb\x1b[1A", "1.0")])).splitlines()[-1] == r"a\nb\x1b[1A  1.0"
    )


def test_all_that_is_printed_is_cleaned(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    echo(f"agent {ESCAPES}")
    echo(BIDI, err=True)
    out, errors = capsys.readouterr()
    assert "\x1b" not in out and "\x07" not in out and "\u202e" not in errors
    assert InputProblem("a\n\x1b").format_message() == r"a\n\x1b"


def test_so_are_the_names_of_files_in_errors() -> None:
    from mdrive_sumo.cli import main

    ended = CliRunner().invoke(main, ["show", "runs/a\x1b[2J/\u202e", "--no-such"])
    assert ended.exit_code == 2 and "\x1b" not in ended.stderr
    ended = CliRunner().invoke(main, ["show", "runs/a\x1b[2J/\u202e"])
    assert ended.exit_code == 2 and "\x1b" not in ended.stderr and "\u202e" not in ended.stderr


@pytest.mark.parametrize(
    "cell", ['=HYPERLINK("http://x")', "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "=1", "-nan(1)", "+1e5x", "--1"]
)
def test_no_cell_is_a_formula(cell: str) -> None:
    assert clean_for_csv(cell) == f"'{cell}"
    assert format_csv_lines([("a",), (cell,)]).splitlines()[1].lstrip('"').startswith("'")


@pytest.mark.parametrize("cell", ["-", "-1", "+0.25", "-1e-05", "1", "-inf", "", "a=b", "-12.5 %"])
def test_numbers_stay_numbers(cell: str) -> None:
    assert clean_for_csv(cell) == cell
    assert format_csv_lines([("a", "b"), (-1.5, 2)]) == "a,b\n-1.5,2\n"


@pytest.mark.parametrize(
    "text",
    [
        "![x](http://evil.example/x.png)", "[x](http://evil.example)", "![x][y]", "[y]: http://evil.example",
        r"\](u)", r"![x\](http://evil)", r"[a\](u)", r"!\[x](u)", "<http://evil.example>",
        "http://evil.example", "www.evil.example",
        "<img src=x>", "&lt;img&gt;", "a | b", "a\n\n# b", "[x] (u)", "![](u)", r"\\![x](u)", r"[x\\](u)", "![x]\\(u)",
    ],
)  # fmt: skip
def test_markdown_has_no_image_link_or_markup(text: str) -> None:
    _check_markdown(text)


@given(st.text(alphabet="![]()\\<>:/w. a`|\n&#*_"))
def test_no_text_becomes_an_image_or_a_link(text: str) -> None:
    _check_markdown(text)


def _check_markdown(text: str) -> None:
    reader = MarkdownIt("commonmark", {"html": True}).enable("table")
    cell = clean_for_markdown(text)
    for page in (f"agent {cell} end", format_markdown(make_text_table(("agent", "DS"), [(text, "1")]))):
        found = {token.type for block in reader.parse(page) for token in (block, *(block.children or ()))}
        assert not found & {"image", "link_open", "html_inline", "html_block", "heading_open", "hr"}, (page, found)
    assert not re.search(r"://|www\.", cell)  # GitHub makes links of these


@pytest.mark.parametrize("command", ["mdrive-sumo eval", "a `b` c", "```", "`", "a\n\nb"])
def test_a_command_stays_code(command: str) -> None:
    tokens = MarkdownIt("commonmark").parse(f"- command: {format_markdown_code(command)}")
    inline = [token for block in tokens for token in block.children or ()]
    assert [token.type for token in inline] == ["text", "code_inline"]
    assert inline[1].content.strip() == clean_line(command)


def test_a_page_shows_what_a_browser_would_act_on() -> None:
    page = PAGE_TEMPLATES.from_string("<p>{{ name }}</p>").render(name=f"{BIDI}</p><script>")
    assert page == r"<p>\u202egnp.\u2066exe\u200f\u061c&lt;/p&gt;&lt;script&gt;</p>"


def test_a_log_line_is_one_line() -> None:
    record = logging.LogRecord("mdrive.worker", logging.INFO, "", 0, "job %s", ("a\nINFO mdrive: fine\x1b[2J",), None)
    text = CleanFormatter("%(levelname)s %(name)s: %(message)s").format(record)
    assert text == r"INFO mdrive.worker: job a\nINFO mdrive: fine\x1b[2J"
