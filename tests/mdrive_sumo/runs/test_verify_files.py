"""`verify` takes no number of a run folder on trust: each attack below was answered with "identical", exit code 0."""

import contextlib
import json
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from testing.journals import rewrite_journal
from testing.scored_pair import PAIR, ROADS, RUN, pair_episode

from mdrive_sumo.api.verification import Permission, RunVerification
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tree_difference import find_tree_differences
from mdrive_sumo.report.run_report import build_run_report, find_report_differences
from mdrive_sumo.runs.stored_run import load_stored_run, load_unchecked_run
from mdrive_sumo.runs.verify import ExpectedResults, find_results_differences
from mdrive_sumo.scoring import Results, ScoreMode, load_results, save_results, score_episode, summarize_run

RESULTS = summarize_run(RUN, [score_episode(pair_episode(), PAIR, ROADS, ScoreMode.MDRIVE, 1)])


def list_numbers(value: Any, place: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Yield the place of every number of a results file."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, inner in entries:
        yield from list_numbers(inner, (*place, name))
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield place


TREE = RESULTS.model_dump(mode="json")
NUMBERS = list(list_numbers(TREE))


def with_number(place: tuple[str | int, ...], step: float) -> Results:
    tree = json.loads(json.dumps(TREE))
    part = tree
    for name in place[:-1]:
        part = part[name]
    part[place[-1]] += step
    return Results.model_validate(tree)


@given(place=st.sampled_from(NUMBERS), step=st.sampled_from((1, 7, 1000)))
def test_every_single_number_of_the_results_is_compared(place: tuple[str | int, ...], step: int) -> None:
    found = list(find_results_differences(ExpectedResults(RESULTS, (), ()), with_number(place, step)))
    assert len(found) == 1
    assert re.search(rf"\.?{place[-1]}: expected \S+, found \S+$", found[0]), found


def test_equal_results_have_no_difference() -> None:
    assert list(find_results_differences(ExpectedResults(RESULTS, (), ()), RESULTS)) == []


@given(data=st.data())
def test_every_digit_of_the_report_is_compared(data: st.DataObject) -> None:
    text = build_run_report(RESULTS)
    rows = [i for i, line in enumerate(text.splitlines()) if line.startswith("|") and re.search(r"\d", line)]
    lines = text.splitlines()
    row = data.draw(st.sampled_from(rows))
    digits = [match.start() for match in re.finditer(r"\d", lines[row])]
    at = data.draw(st.sampled_from(digits))
    lines[row] = lines[row][:at] + str((int(lines[row][at]) + 1) % 10) + lines[row][at + 1 :]
    (found,) = find_report_differences(RESULTS, "\n".join(lines))
    assert found.startswith(f"line {row + 1}: expected | ") and found.endswith(lines[row][-40:])


def test_a_report_without_a_line_or_with_one_more() -> None:
    lines = build_run_report(RESULTS).splitlines()
    assert list(find_report_differences(RESULTS, "\n".join(lines))) == []
    table = next(i for i, line in enumerate(lines) if line.startswith("| **bucket mean"))
    assert list(find_report_differences(RESULTS, "\n".join(lines[:table] + lines[table + 1 :])))
    assert list(find_report_differences(RESULTS, "\n".join([*lines, "| more | 1 |"])))


@pytest.mark.parametrize(
    ("expected", "found", "says"),
    [
        ({"a": 1.0}, {"a": 1}, []),
        ({"a": 1}, {"a": True}, ["a: expected 1, found True"]),
        ({"a": None}, {"a": 0.0}, ["a: expected None, found 0.0"]),
        ({"a": 1, "b": 2}, {"b": 2, "c": 3}, ["a: expected 1, found nothing", "c: expected nothing, found 3"]),
        ([{"id": "x", "v": 1}], [{"id": "x", "v": 2}], ["[x].v: expected 1, found 2"]),
        ([1, 2], [1], [": expected 2 entries, found 1"]),
        ({"a": float("nan")}, {"a": float("nan")}, ["a: expected nan, found nan"]),
    ],
)
def test_differences_are_named_by_place(expected: Any, found: Any, says: list[str]) -> None:
    assert list(map(str, find_tree_differences(expected, found))) == says


# From here on with the simulation.

TOWN = "i07_ins_ss_town"


def invoke(*words: str | int | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished") / "run"
    ended = invoke(
        "eval",
        "--suite",
        "interdrive@0",
        "--scenario",
        TOWN,
        "--agent",
        "constant-speed",
        "--workers",
        1,
        "--out",
        folder,
    )
    assert ended.exit_code == 0, ended.output
    assert invoke("rescore", folder, "--score-mode", "interdrive_fixed").exit_code == 0
    return folder


def verify(folder: Path) -> list[str]:
    ended = invoke("verify", folder, "--workers", 1)
    assert ended.exit_code == 1, ended.output
    return ended.stdout.splitlines()


def substitute(path: Path, change: Callable[[str], str]) -> None:
    text = path.read_text()
    assert change(text) != text
    path.write_text(change(text))


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_changed_scores_are_named_with_file_and_place(finished: Path, tmp_path: Path) -> None:
    """Four attacks in one folder: DS 99.5 everywhere, a line of the report, a forged journal, a rescored file."""
    run = shutil.copytree(finished, tmp_path / "run")
    true = load_results(run / "results.json").scenarios[0].ds
    substitute(run / "results.json", lambda text: re.sub(r'"ds": [\d.]+', '"ds": 99.5', text))
    substitute(run / "report.md", lambda text: text.replace(f"{true:.2f}", "99.50"))
    rewrite_journal(run / "journal.jsonl", lambda line: re.sub(r'"ds":[\d.]+', '"ds":99.5', line))
    fixed = load_results(run / "results-interdrive_fixed.json")
    again = fixed.scenarios[0].model_copy(update={"sr": 100.0})
    save_results(summarize_run(fixed.run, [again]), run / "results-interdrive_fixed.json")
    lines = verify(run)
    assert f"results.json: scenarios[{TOWN}].ds: expected {true}, found 99.5" in lines
    assert f"results.json: overall.bucket_mean.ds: expected {true}, found 99.5" in lines
    assert f"results-interdrive_fixed.json: scenarios[{TOWN}].sr: expected 0.0, found 100.0" in lines
    assert f"journal.jsonl: results[{TOWN}].ds: expected {true}, found 99.5" in lines
    assert any(re.match(rf"report.md: line \d+: expected .*{true:.2f}.*, found .*99\.50", line) for line in lines)


@pytest.mark.slow
def test_a_forgery_that_agrees_with_itself_is_found(finished: Path, tmp_path: Path) -> None:
    """Every figure of a perfect drive, means and report included: nothing but a second execution can tell."""
    run = shutil.copytree(finished, tmp_path / "run")
    stored = load_results(run / "results.json")
    perfect = {"ds": 100.0, "rc": 100.0, "ip": 1.0}
    egos = tuple(ego.model_copy(update={**perfect, "infractions": ()}) for ego in stored.scenarios[0].egos)
    scenario = stored.scenarios[0].model_copy(update={**perfect, "sr": 100.0, "efficient_sr": 100.0, "egos": egos})
    forged = summarize_run(stored.run.model_copy(update={"agent": "mine.py:Agent"}), [scenario])
    save_results(forged, run / "results.json")
    (run / "report.md").write_text(build_run_report(forged))
    assert invoke("compare", run, finished).exit_code == 0
    text = "\n".join(verify(run))
    assert f"results.json: scenarios[{TOWN}].sr: expected 0.0, found 100.0" in text
    assert re.search(r"results.json: scenarios\[\w+\].egos\[0\].infractions: expected \d entries, found 0", text)
    assert "results.json: run.agent: expected 'constant-speed', found 'mine.py:Agent'" in text


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_the_numbers_of_a_larger_run_are_not_left_out(finished: Path, tmp_path: Path) -> None:
    """A run that lost a scenario, and its means with it."""
    run = shutil.copytree(finished, tmp_path / "run")
    rewrite_journal(run / "journal.jsonl", lambda line: line.replace(f'"scenario":"{TOWN}"', '"scenario":"i0[78]*"'))
    text = "\n".join(verify(run))
    assert re.search(r"results.json: scenarios: expected 'i08\w*', which the run drives, found nothing", text)
    ended = invoke("rescore", run)
    assert ended.exit_code == 2
    assert re.search(r"expected the 2 that 'i0\[78\]\*' selects, found 1, 'i08\w*' missing", ended.stderr)


ODD = (None, True, -1, 1e308, "", "x", [], {}, [[]], {"id": 1}, 2**70)


def mutate(tree: Any, data: st.DataObject) -> Any:
    """Replace or delete a value somewhere in a JSON value."""
    above, part, name = tree, tree, None
    while isinstance(part, dict | list) and part and (name is None or data.draw(st.integers(0, 3))):
        above, names = part, sorted(part) if isinstance(part, dict) else range(len(part))
        name = data.draw(st.sampled_from(names))
        part = above[name]
    if name is not None and data.draw(st.booleans()):
        above[name] = data.draw(st.sampled_from(ODD))
    elif name is not None:
        del above[name]
    return tree


@pytest.mark.full
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100, deadline=None)
@given(data=st.data())
def test_a_mutated_run_folder_is_a_sentence_or_a_difference(
    finished: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Nothing but InputError comes out of what a stranger wrote into results or journal."""
    run = shutil.copytree(finished, tmp_path_factory.mktemp("mutated") / "run")
    if data.draw(st.booleans()):
        results = mutate(json.loads((run / "results.json").read_text()), data)
        (run / "results.json").write_text(json.dumps(results))
    else:
        first = data.draw(st.booleans())

        def change(line: str) -> str:
            is_chosen = ('"fingerprint"' in line) is first
            return json.dumps(mutate(json.loads(line), data)) if is_chosen else line

        rewrite_journal(run / "journal.jsonl", change)
    with contextlib.suppress(InputError):
        list(RunVerification(load_unchecked_run(run), Permission()).verify_files())
    with contextlib.suppress(InputError):
        load_stored_run(run)
