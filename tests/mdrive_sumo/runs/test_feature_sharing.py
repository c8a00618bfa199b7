"""A stranger's agent shares maps of features over real channels: what arrives, what is recorded, shown and exported."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from testing.short_suite import make_short_suite

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.loop.recorded_actions import RecordedActions
from mdrive_sumo.report.replay_messages import build_message_tables
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.v2x.channel import DeliveryStatus
from mdrive_sumo.v2x.messages import FEATURE, Feature, decode

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]
AGENT = '''
import numpy as np
from mdrive_sumo.contract import Control, Note, Reply, SensorSpec
from mdrive_sumo.v2x.feature_map import assemble_feature_map, encode_feature_map
from mdrive_sumo.v2x.messages import FEATURE, FeatureGrid, ReferencePose, decode

GRID = FeatureGrid("test-grid", 1, 1.6, 64, 64, 16)


def draw_map(tick):
    """What a sender's network would make of its scan: here both ends know it by its tick."""
    rng = np.random.default_rng(tick)
    seen = rng.random((64, 64)) < 0.1
    return rng.integers(0, 16, (16, 64, 64)) * seen * 1.0, seen * rng.uniform(0.1, 1.0, seen.shape)


class Sharer:
    """Sends a map of what it saw every half second; notes what arrives of those of others."""

    label = "sharing"

    def __init__(self, config): self.received = {}
    def sensors(self): return (SensorSpec("objects", "objects"),)
    def start(self, briefing): ...

    def act(self, seen):
        notes = []
        for message in seen.messages:
            assert message.type == FEATURE
            feature = decode(message)
            of_map = self.received.setdefault((message.sender, feature.pose.tick), [])
            of_map.append(feature)
            found = assemble_feature_map(of_map, GRID)
            expected, _ = draw_map(feature.pose.tick)
            assert np.abs(found.features - expected * found.arrived).max() < 0.01, "another map arrived"
            notes.append(Note("map", f"{message.sender} {feature.pose.tick} {found.arrived.mean():.3f}"))
        messages = ()
        if seen.tick % 10 == 0:
            pose = ReferencePose(seen.own.x, seen.own.y, seen.own.yaw, seen.tick)
            messages = encode_feature_map(*draw_map(seen.tick), pose, GRID, bits=4, budget_bytes=6000)
        return Reply(control=Control(0.4, 0.0, 0.0), messages=messages, notes=tuple(notes))
'''


def invoke(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("features")
    make_short_suite(folder / "suite", "i02*")
    (folder / "sharer.py").write_text(AGENT)
    return folder


def drive(folder: Path, channel: str, *options: str) -> EpisodeRecord:
    """Return the recording of a run."""
    run = folder / "-".join((channel, *options))
    words = (
        "--suite",
        folder / "suite",
        "--agent",
        f"{folder}/sharer.py:Sharer",
        "--workers",
        "1",
        "--out",
        run,
        "--ids",
        "scenario",
    )
    if not run.exists():
        ended = invoke("eval", *words, "--comm", channel, *options)
        assert ended.exit_code == 0 and "failed" not in ended.output, ended.output
    (recording,) = (run / "episodes").iterdir()
    return load_episode(recording)


def read_shares(record: EpisodeRecord) -> dict[tuple[str, ...], float]:
    """By receiver, sender and tick, the share of the cells that arrived in the end of a map of which any did."""
    heard = [(note.ego, *note.note.text.split()) for note in record.notes if note.note.kind == "map"]
    return {tuple(words): float(share) for *words, share in heard}


def list_statuses(record: EpisodeRecord) -> set[DeliveryStatus]:
    return {one.status for sent in record.messages for one in sent.deliveries.values()}


def list_delays(record: EpisodeRecord) -> set[int]:
    return {
        tick - sent.message.tick
        for sent in record.messages
        for status, tick in sent.deliveries.values()
        if status is DeliveryStatus.DELIVERED
    }


def test_what_arrives_of_a_map_is_used_on_every_channel(folder: Path) -> None:
    ideal, realistic, radio = (drive(folder, channel) for channel in ("ideal", "realistic", "its-g5"))
    contents = [decode(sent.message) for sent in ideal.messages]
    assert len(contents) > 10 and all(isinstance(content, Feature) for content in contents)
    assert {sent.message.type for sent in ideal.messages} == {FEATURE}
    whole = read_shares(ideal)
    assert min(whole.values()) > 0.9 and list_delays(ideal) == {1}
    assert list_delays(realistic) == {2} and DeliveryStatus.LOST in list_statuses(realistic)
    lossy = read_shares(realistic)
    cut = [share for key, share in lossy.items() if share < whole[key]]
    assert cut and min(cut) > 0.0, "a lost packet leaves the tiles of the others"
    assert len(list_delays(radio)) > 2, "the packets of a map arrive one after another"
    assert read_shares(radio)
    results = json.loads((folder / "ideal" / "results.json").read_text())
    assert "sharing" in results["run"]["labels"] and [*results["scenarios"][0]["exchanged"]] == [FEATURE]


def test_a_switch_leaves_the_content_out_of_recordings_and_nothing_else(folder: Path) -> None:
    whole, bare = drive(folder, "realistic"), drive(folder, "realistic", "--no-record-features")
    assert np.array_equal(whole.digests, bare.digests)
    assert (whole.dropped_payloads, bare.dropped_payloads) == ((), (FEATURE,))
    for kept, dropped in zip(whole.messages, bare.messages, strict=True):
        assert dropped.message.payload == bytes(len(kept.message.payload))
        assert (dropped.message.tick, dropped.deliveries) == (kept.message.tick, kept.deliveries)
    sizes = [next((folder / name / "episodes").iterdir()).stat().st_size for name in ("realistic", RUN_WITHOUT)]
    payloads = sum(len(sent.message.payload) for sent in whole.messages)
    assert 0.3 * payloads < sizes[0] - sizes[1] <= payloads, "once each, and all send the same maps here"
    for name in ("realistic", RUN_WITHOUT):
        ended = invoke("verify", folder / name, "--trust-agent", "--workers", "1")
        assert ended.exit_code == 0 and "identical" in ended.output, ended.output
    with pytest.raises(InputError, match=r"found a recording without that of feature .*, which cannot be driven again"):
        RecordedActions(bare, bare.ego_ids[0], is_entered=True)


RUN_WITHOUT = "realistic---no-record-features"


@pytest.mark.parametrize("options", [(), ("--no-record-features",)])
def test_replays_and_tables_show_that_features_were_sent(folder: Path, options: Sequence[str], tmp_path: Path) -> None:
    record = drive(folder, "realistic", *options)
    scenario = load_suite(folder / "suite").scenarios[0]
    header, tables = build_message_tables(record, scenario, np.zeros(2))
    assert header["types"] == [FEATURE] and header["problems"] == []
    sizes = [len(sent.message.payload) for sent in record.messages]
    assert sorted(tables["messages"][3].tolist()) == sorted(sizes)
    texts = {text for _, text in header["texts"]}
    assert len(header["texts"]) == len(sizes)
    if options:
        assert texts == {"content not recorded (--no-record-features)"}
    else:
        assert all("tiles of test-grid version 1, confidence" in text for text in texts)
    run = folder / "-".join(("realistic", *options))
    assert invoke("export", run, "--format", "csv", "--out", tmp_path / "tables").exit_code == 0
    (table,) = (tmp_path / "tables").rglob("*messages*.csv")
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["type"] for row in rows} == {FEATURE} and {int(row["bytes"]) for row in rows} == set(sizes)
    refused = invoke("export", run, "--format", "pcap", "--out", tmp_path / "captures")
    assert refused.exit_code == 2 and f"found {len(sizes)} feature" in " ".join(refused.output.split())
