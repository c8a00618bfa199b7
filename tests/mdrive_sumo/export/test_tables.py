"""CSV and Parquet, read back with pandas."""

import csv
import io
import json
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from testing.mixed_run import CAVS, GUEST

from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.export.export_tables import EXPORT_TABLES
from mdrive_sumo.runs.stored_run import StoredRun

from .conftest import Export

if TYPE_CHECKING:
    import pandas as pd

pytestmark = pytest.mark.slow  # of an episode that is driven

TABLES = [table.name for table in EXPORT_TABLES]


def read_csv(exported: Export, name: str) -> "pd.DataFrame":
    import pandas as pd  # only here: every process of the tests collects this module

    return pd.read_csv(exported("csv") / f"{name}.csv", dtype={"id": str, "cav": str, "sender": str, "receiver": str})


def test_states_are_the_recorded_poses(exported: Export, record: EpisodeRecord) -> None:
    states = read_csv(exported, "states")
    assert len(states) == record.valid.sum()
    for name in ("x", "y", "yaw", "speed"):
        table = states.pivot(index="tick", columns="id", values=name)[list(record.ids)].to_numpy()
        assert (np.isfinite(table) == record.valid).all()
        assert np.abs(table - getattr(record, name))[record.valid].max() < 1e-9
    assert (states.time_s - states.tick * DT).abs().max() < 1e-9
    assert set(states[states.is_cav].id) == set(CAVS)
    assert states[states.is_cav].throttle.notna().all() and states[~states.is_cav].throttle.isna().all()


def test_a_road_user_has_rows_while_it_is_there(exported: Export) -> None:
    guest = read_csv(exported, "states").query("id == 'guest'")
    assert (guest.time_s.min(), guest.time_s.max()) == GUEST


def test_messages_events_and_scores_are_tables_of_their_own(
    exported: Export, record: EpisodeRecord, stored: StoredRun
) -> None:
    messages, events, scores = (read_csv(exported, name) for name in ("messages", "events", "cav_scores"))
    assert len(messages) == sum(len(sent.deliveries) for sent in record.messages) > 0
    assert set(messages.sender) == set(CAVS) and set(messages.type) == {"text"}
    assert messages[messages.delivery == "delivered"].eval("delivery_tick > tick").all()
    (result,) = stored.results.scenarios
    kinds = [one.kind for ego in result.egos for one in ego.infractions] + [str(one.end) for one in record.endings]
    assert sorted(events.event) == sorted(kinds)
    assert scores.set_index("cav").ds.to_dict() == pytest.approx({ego.id: ego.ds for ego in result.egos})
    assert read_csv(exported, "scores").ds.tolist() == pytest.approx([result.ds])
    assert read_csv(exported, "signals").state.tolist() == [change.state for change in record.signals]


@pytest.mark.parametrize("name", TABLES)
def test_parquet_has_the_same_rows_as_csv_and_says_the_units(exported: Export, name: str) -> None:
    from pyarrow import parquet

    table = parquet.read_table(exported("parquet") / f"{name}.parquet")
    frame, text = table.to_pandas(), read_csv(exported, name)
    assert list(frame.columns) == list(text.columns) and len(frame) == len(text)
    for column in frame.columns:
        same = (frame[column] == text[column]) | (frame[column].isna() & text[column].isna())
        assert (same | (frame[column] == "")).all(), column
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert units == {column.name: column.unit for one in EXPORT_TABLES if one.name == name for column in one.columns}


CASTS = {
    "string": str,
    "integer": int,
    "number": float,
    "boolean": {
        "true": True,
        "True": True,
        "TRUE": True,
        "1": True,
        "false": 0,
        "False": 0,
        "FALSE": 0,
        "0": 0,
    }.__getitem__,
}
"""Types of Table Schema 1 with the texts that it takes for booleans by default."""


def test_the_data_package_keeps_the_published_rules(exported: Export) -> None:
    """Those of the profiles tabular-data-package and tabular-data-resource, version 1, for what is in the file.

    frictionless 5.18 found the package of this run valid; it needs 42 packages, so it is not installed here.
    """
    folder = exported("csv")
    package = json.loads((folder / "datapackage.json").read_text())
    assert package["profile"] == "tabular-data-package"
    names = [package["name"], *(resource["name"] for resource in package["resources"])]
    assert all(re.fullmatch(r"[-a-z0-9._/]+", name) for name in names) and len(set(names)) == len(names)
    for resource in package["resources"]:
        assert resource["profile"] == "tabular-data-resource"
        assert not resource["path"].startswith(("/", "."))
        fields = resource["schema"]["fields"]
        text = (folder / resource["path"]).read_bytes().decode(resource["encoding"])
        rows = list(csv.reader(io.StringIO(text, newline="")))
        assert rows[0] == [field["name"] for field in fields] and len(set(rows[0])) == len(rows[0])
        for row in rows[1:]:
            for field, cell in zip(fields, row, strict=True):
                assert cell == "" or CASTS[field["type"]](cell) is not None


def test_the_data_package_describes_every_column_of_every_file(exported: Export) -> None:
    package = json.loads((exported("csv") / "datapackage.json").read_text())
    assert [resource["name"] for resource in package["resources"]] == TABLES
    for resource in package["resources"]:
        fields = resource["schema"]["fields"]
        header = (exported("csv") / resource["path"]).read_bytes().decode().partition("\r\n")[0].split(",")
        assert [field["name"] for field in fields] == header
        assert all(field["description"] for field in fields)
