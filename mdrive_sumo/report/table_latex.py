r"""Report tables as LaTeX: `table` environments with booktabs rules, to be included with `\input`."""

import re

from mdrive_sumo.core.tables import Cell, Column, Table, format_cell

PACKAGES = (
    r"\usepackage{amssymb}",
    r"\usepackage{booktabs}",
    r"\usepackage{graphicx}",
    r"\usepackage[normalem]{ulem}",
)
"""What the preamble needs: check marks, rules, tables no wider than the text, wavy lines under third places."""
MARKS = {1: r"\textbf{%s}", 2: r"\underline{%s}", 3: r"\uwave{%s}"}
"""As in the paper's main table (mdrive.tex, tab:mdrive_results)."""
MARKS_LEGEND = r"\textbf{Bold}, \underline{underline} and \uwave{wavy} marks: first, second and third place."
FIT = r"\resizebox{\ifdim\width>\textwidth\textwidth\else\width\fi}{!}{%"
"""Scales a table down to the width of the text if it is wider."""
_ESCAPES = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "_": r"\_",
    "%": r"\%",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': "''",  # \textquotedbl needs the T1 encoding
    "[": "{[}",  # after \\ a bracket would be an optional argument
    "]": "{]}",
    "*": "{*}",  # likewise a star
    "±": r"$\pm$",
    "×": r"$\times$",
    "✓": r"\checkmark{}",
    "°": r"$^\circ$",
    "–": "--",
    "↑": r"$\uparrow$",
    "↓": r"$\downarrow$",
    "Δ": r"$\Delta$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
}
_SIGNED = re.compile(r"(?<![\w.])[-+](?=\d)")


def format_latex(table: Table) -> str:
    """Return a table with caption and label `tab:NAME`; the best three are bold, underlined and waved.

    The document needs `PACKAGES`.
    """
    text_columns = max(1, table.text_columns)
    layout = "l" * text_columns + "r" * (len(table.columns) - text_columns)
    lines = [
        "% Needs " + " ".join(PACKAGES),
        r"\begin{table}[htbp]",
        r"\centering",
        r"\footnotesize",
        rf"\caption{{{_format_caption(table)}}}",
        rf"\label{{tab:{table.name}}}",
        r"\vspace{0.2cm}",
        FIT,
        rf"\begin{{tabular}}{{{layout}}}",
        r"\toprule",
        *_format_header(table),
        *_format_body(table),
        r"\bottomrule",
        r"\end{tabular}}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def format_latex_document(names: tuple[str, ...], title: str) -> str:
    r"""Return a document that includes the tables NAME.tex beside it, to look at all of them."""
    return "\n".join(
        (
            r"\documentclass{article}",
            r"\usepackage[utf8]{inputenc}",
            r"\usepackage[a4paper,landscape,margin=15mm]{geometry}",
            *PACKAGES,
            r"\begin{document}",
            rf"\section*{{{escape_latex(title)}}}",
            *(rf"\input{{{name}.tex}}" for name in names),
            r"\end{document}",
            "",
        )
    )


def escape_latex(text: str) -> str:
    """Return text that LaTeX prints as it is; other characters beyond ASCII become a question mark."""
    collapsed = re.sub(r"\s+", " ", text)
    return "".join(_ESCAPES.get(char) or (char if char.isascii() and char.isprintable() else "?") for char in collapsed)


def _format_caption(table: Table) -> str:
    parts = (rf"\textbf{{{escape_latex(table.title)}.}}", escape_latex(table.note))
    return " ".join((*(part for part in parts if part), *((MARKS_LEGEND,) if table.has_marks else ())))


def _format_header(table: Table) -> list[str]:
    lines: list[str] = []
    if groups := table.groups:
        spans = [rf"\multicolumn{{{count}}}{{c}}{{{escape_latex(name)}}}" if name else "" for name, count in groups]
        lines.append(_join(spans))
        lines.append(" ".join(_format_rules(groups)))
    lines.append(_join([escape_latex(column.label) for column in table.columns]))
    return lines


def _format_rules(groups: tuple[tuple[str, int], ...]) -> list[str]:
    rules: list[str] = []
    first = 1
    for name, count in groups:
        if name:
            rules.append(rf"\cmidrule(lr){{{first}-{first + count - 1}}}")
        first += count
    return rules


def _format_body(table: Table) -> list[str]:
    lines: list[str] = []
    for section, rows in table.sections:
        lines.append(r"\midrule")
        if section:
            lines.append(rf"\multicolumn{{{len(table.columns)}}}{{l}}{{\textit{{{escape_latex(section)}}}}} \\")
        lines += [
            _join([_format_marked(cell, column) for cell, column in zip(row.cells, table.columns, strict=True)])
            for row in rows
        ]
    return lines


def _join(cells: list[str]) -> str:
    return " & ".join(cells) + r" \\"


def _format_marked(cell: Cell, column: Column) -> str:
    text = escape_latex(format_cell(cell, column))
    if cell.number is not None:
        text = _SIGNED.sub(lambda sign: f"${sign.group()}$", text)
    return MARKS[cell.rank] % text if cell.rank in MARKS else text
