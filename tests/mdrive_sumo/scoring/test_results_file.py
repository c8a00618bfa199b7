"""The results file: form, schema, and refusal of unusable files."""

import json
from pathlib import Path

import pytest
from testing.score_golden import scenario
from testing.scored_pair import PAIR, ROADS, RUN, pair_episode

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scoring import (
    Results,
    ScoreMode,
    build_results_schema,
    load_results,
    make_void_result,
    save_results,
    score_episode,
    summarize_run,
)


def full_results() -> Results:
    found = score_episode(pair_episode(), PAIR, ROADS, ScoreMode.MDRIVE, 1)
    return summarize_run(RUN, [found, make_void_result(scenario(id="e"), 1, "SUMO stopped")])


def test_results_come_back_as_they_were_saved(tmp_path: Path) -> None:
    saved = full_results()
    save_results(saved, tmp_path / "results.json")
    first = (tmp_path / "results.json").read_bytes()
    assert load_results(tmp_path / "results.json") == saved
    save_results(load_results(tmp_path / "results.json"), tmp_path / "results.json")
    assert (tmp_path / "results.json").read_bytes() == first
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


def test_the_file_has_the_published_form(tmp_path: Path) -> None:
    save_results(full_results(), tmp_path / "results.json")
    data = json.loads((tmp_path / "results.json").read_text())
    assert list(data) == ["format", "run", "overall", "buckets", "void", "scenarios"]
    assert data["format"] == "mdrive-sumo/results/4"
    assert set(data["overall"]) == {"bucket_mean", "scenario_mean", "timed", "scalars"}
    one = data["scenarios"][0]
    assert set(one) == {
        *(
            "id",
            "bucket",
            "category",
            "place",
            "seed",
            "status",
            "reason",
            "ds",
            "sr",
            "rc",
            "ip",
            "efficient_sr",
            "time_ratio",
        ),
        *("min_ttc", "scalars", "digest", "ticks", "egos", "comm", "exchanged", "notes"),
    }
    assert set(one["egos"][0]) == {
        "id",
        "outcome",
        "reason",
        "ds",
        "rc",
        "ip",
        "ticks",
        "time_ratio",
        "infractions",
        "speeding",
    }
    collision, stop_sign = one["egos"][0]["infractions"]
    assert set(stop_sign) == {"kind", "tick", "x", "y", "factor", "other"}
    assert set(collision) == set(stop_sign) | {"impact_speed"}


def test_the_schema_describes_every_key_of_the_file() -> None:
    schema = build_results_schema()
    data = full_results().model_dump(mode="json")
    assert set(schema["properties"]) == set(data) | {"planned"}
    assert set(schema["$defs"]["ScenarioResult"]["properties"]) == set(data["scenarios"][0]) | {
        "scalars",
        "sensing_track",
        "malformed",
        "sent_rates",
        "busy_ratio",
    }
    assert schema["$defs"]["ScenarioResult"]["additionalProperties"] is False
    assert schema["properties"]["format"]["const"] == "mdrive-sumo/results/4"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "cannot be read"),
        ("{", "expected JSON"),
        ("[1]", "results.json: "),
        ("\xff", "expected JSON"),
        (
            '{"format": "mdrive-sumo/results/9"}',
            "expected 'mdrive-sumo/results/4', found 'mdrive-sumo/results/9'",
        ),
        ("{}", "format: expected 'mdrive-sumo/results/4', found None"),
        ('{"format": "mdrive-sumo/results/4"}', "run: Field required"),
    ],
)
def test_an_unusable_file_is_refused_in_one_sentence(tmp_path: Path, text: str | None, says: str) -> None:
    path = tmp_path / "results.json"
    if text is not None:
        path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError) as caught:
        load_results(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_keys_and_nan_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    for change in ({"more": 1}, {"void": float("nan")}):
        path.write_text(json.dumps({**full_results().model_dump(mode="json"), **change}))
        with pytest.raises(InputError):
            load_results(path)
