"""Clean text that others have written before it leaves for a terminal, a table, a Markdown page or a log.

A run folder, a log or an agent may hold any characters. On a terminal, escape sequences move the cursor and marks of
direction show other text than there is; a cell that begins with "=" is a formula of a spreadsheet; an image in
Markdown is fetched when the page is shown. One function for each destination; pages are escaped by their templates.
"""

import re

_CONTROLS = "\x00-\x08\x0b-\x1f\x7f-\x9f"
"""Characters of control (Unicode category Cc) but tab and line feed."""
_MARKS = "\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\U000e0000-\U000e007f"
"""Marks of direction (Unicode Bidi_Control), separators of lines and paragraphs, and characters that show nothing."""
_LONE_SURROGATES = "\ud800-\udfff"
_UNSAFE = re.compile(f"[{_CONTROLS}{_MARKS}{_LONE_SURROGATES}]")
_UNSAFE_LINE = re.compile(f"[\t\n{_CONTROLS}{_MARKS}{_LONE_SURROGATES}]")
_FORMULA = re.compile(r"[=+\-@\t\r]")
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?( ?%)?|-|[-+]?inf|nan")
"""What begins as a formula does and is none: a number, or the dash of an undefined one."""
_MARKDOWN = (
    (re.compile(r"\\(?=[!-/:-@\[-`{-~])"), r"\\\\"),  # first: a backslash could take the escape of what follows
    (re.compile(r"!(?=\[)"), r"\\!"),
    (re.compile(r"\](?=[\[(:])"), r"\\]"),
    (re.compile(r"://"), r":\\//"),
    (re.compile(r"(?i)\b(www)\."), r"\1\\."),
)
"""What makes text an image or a link in Markdown, also in that of GitHub. The rest is emphasis and code at worst."""


def clean_for_terminal(text: str) -> str:
    """Return text in which what a terminal would act on is shown as an escape, e.g. "\\x1b"; lines and tabs stay."""
    return _UNSAFE.sub(_escape, text)


def clean_line(text: str) -> str:
    """As `clean_for_terminal`, for a log line or a cell: line breaks and tabs are shown as escapes, too."""
    return _UNSAFE_LINE.sub(_escape, text)


def clean_for_csv(text: str) -> str:
    """Return the text of a CSV cell that no spreadsheet takes for a formula: an apostrophe goes before it if needed.

    OWASP, "CSV Injection": cells that begin with one of = + - @, a tab or a carriage return. Numbers stay as they are.
    """
    text = _UNSAFE.sub(_escape, text)
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def clean_for_page(value: object) -> object:
    """Return a value of a template (its `finalize`): text that is not markup shows its characters of control.

    The template escapes markup itself. What a page's script shows comes as JSON, which has its own escapes.
    """
    return clean_for_terminal(value) if type(value) is str else value


def clean_for_markdown(text: str) -> str:
    """Return text that can neither break a Markdown table nor become HTML, a link or an image.

    White space collapses to one space.
    """
    text = re.sub(r"\s+", " ", text)
    text = _UNSAFE.sub(_escape, text)
    for pattern, made in _MARKDOWN:
        text = pattern.sub(made, text)
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|")


def format_markdown_code(text: str) -> str:
    """Return text as code in a line of Markdown, between as many backticks as it needs (CommonMark, section 6.1)."""
    text = clean_line(text)
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    return f"{'`' * (longest + 1)} {text} {'`' * (longest + 1)}" if longest else f"`{text}`"


def _escape(match: re.Match[str]) -> str:
    return match[0].encode("unicode_escape").decode("ascii")


def truncate(text: str, max_length: int) -> str:
    """Return a text of at most `max_length` characters; three dots stand for what is cut off."""
    return text if len(text) <= max_length else text[: max_length - 3] + "..."
