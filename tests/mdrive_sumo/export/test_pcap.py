"""Capture files: `tshark` reads them without an error, and finds what was sent."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from testing.local_executor import run_in_process
from testing.short_suite import make_short_suite
from testing.study_samples import invoke

from mdrive_sumo.core.state import Kind
from mdrive_sumo.export.etsi_values import LATITUDE_M, LONGITUDE_M, place_front
from mdrive_sumo.export.export_run import export_runs, load_recordings, select_recorded
from mdrive_sumo.export.pcap_capture import write_pcap
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.runs.stored_run import StoredRun, load_stored_run
from mdrive_sumo.v2x.channel import NOT_TRANSMITTED, SentMessage
from mdrive_sumo.v2x.messages import Cam, Cpm, Denm, EventCause, ReferencePose, Termination, decode, encode

pytestmark = [
    pytest.mark.slow,  # of an episode that is driven
    pytest.mark.skipif(shutil.which("tshark") is None, reason="needs tshark"),
]
SCENARIO = "i11_ins_sl_town"


@pytest.fixture(scope="module")
def talk_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose CAVs send CAMs, CPMs and MCMs; some of those of CAV 1 are muted."""
    folder = tmp_path_factory.mktemp("talk")
    suite = make_short_suite(folder / "suite", SCENARIO, metres=25)
    words = ("--agent", "sharing+negotiation", "--comm", "realistic", "--comm-mute", "1/cam@40", "--workers", "1")
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        driven = invoke("eval", "--suite", suite, *words, "--out", folder / "run")
    assert driven.exit_code == 0, driven.output
    return folder / "run"


@pytest.fixture(scope="module")
def talk(talk_folder: Path) -> StoredRun:
    return load_stored_run(talk_folder)


@pytest.fixture(scope="module")
def talk_recording(talk: StoredRun) -> ScoredRecording:
    (found,) = load_recordings(talk, select_recorded(talk))
    return found


@pytest.fixture(scope="module")
def capture(talk: StoredRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_runs([talk], "pcap", tmp_path_factory.mktemp("pcap") / "out") / f"{SCENARIO}.pcap"


def read_with_tshark(capture: Path, *options: str) -> str:
    done = subprocess.run(
        ("tshark", "-n", "-r", str(capture), *options), check=True, capture_output=True, text=True, timeout=120
    )
    return done.stdout


@pytest.fixture(scope="module")
def packets(capture: Path) -> list[dict[str, Any]]:
    """The layers of every frame as tshark sees them."""
    return [one["_source"]["layers"] for one in json.loads(read_with_tshark(capture, "-T", "json"))]


def list_sent(recording: ScoredRecording, kind: type) -> list[tuple[SentMessage, Any]]:
    """Return the messages of that content that were transmitted, in order."""
    transmitted = (
        sent
        for sent in recording.record.messages
        if not any(delivery.status in NOT_TRANSMITTED for delivery in sent.deliveries.values())
    )
    decoded = [(sent, decode(sent.message)) for sent in transmitted]
    return [(sent, content) for sent, content in decoded if isinstance(content, kind)]


def find_all(tree: Any, name: str) -> list[Any]:
    """Return all values of a field in the order of the frame, at any depth."""
    if isinstance(tree, dict):
        return [found for key, value in tree.items() for found in ([value] if key == name else find_all(value, name))]
    return [found for value in tree for found in find_all(value, name)] if isinstance(tree, list) else []


def test_tshark_finds_no_error(capture: Path) -> None:
    assert read_with_tshark(capture, "-Y", "_ws.malformed || _ws.expert || data") == ""


def test_every_transmitted_cam_and_cpm_is_a_frame(capture: Path, talk_recording: ScoredRecording) -> None:
    cams, cpms = list_sent(talk_recording, Cam), list_sent(talk_recording, Cpm)
    ports = read_with_tshark(capture, "-T", "fields", "-e", "btpb.dstport", "-e", "its.messageID").split()
    assert min(len(cams), len(cpms)) > 20
    assert (ports.count("2001"), ports.count("2009")) == (len(cams), len(cpms))
    described = json.loads((capture.parent / f"{SCENARIO}.stations.json").read_text())
    assert described["left_out"].keys() == {"mcm", "cam (muted)"} and described["left_out"]["cam (muted)"] == 1
    pseudonyms = {real: name for name, real in talk_recording.record.pseudonyms.items()}
    assert {s: one["station_id"] for s, one in described["stations"].items()} == {
        station: int(pseudonyms[station], 16) for station in described["stations"]
    }


def test_tshark_reads_the_cams_that_were_sent(packets: list[Any], talk_recording: ScoredRecording) -> None:
    frames = [packet for packet in packets if packet["btpb"]["btpb.dstport"] == "2001"]
    for frame, (sent, cam) in zip(frames, list_sent(talk_recording, Cam), strict=True):
        (longitude,), (latitude,) = find_all(frame["its"], "its.longitude"), find_all(frame["its"], "its.latitude")
        place = int(longitude) * LONGITUDE_M / 1e7, int(latitude) * LATITUDE_M / 1e7
        assert np.hypot(*np.subtract(place, place_front(cam.pose, cam.length))) < 0.009
        (speed,) = find_all(frame["its"], "its.speedValue")
        assert int(speed) == round(abs(cam.speed) * 100)
        assert float(frame["frame"]["frame.time_epoch"]) == pytest.approx(sent.message.tick * 0.05, abs=1e-4)


def test_tshark_reads_the_objects_of_cpms(packets: list[Any], talk_recording: ScoredRecording) -> None:
    """Places, speeds and sizes in the world, computed back from those relative to the middle of the front."""
    frames = [packet for packet in packets if packet["btpb"]["btpb.dstport"] == "2009"]
    count = 0
    for frame, (sent, cpm) in zip(frames, list_sent(talk_recording, Cpm), strict=True):
        column = talk_recording.record.ego_ids.index(sent.message.sender)
        front = np.array(place_front(cpm.pose, float(talk_recording.record.length[column])))
        turn = np.array(((np.cos(cpm.pose.yaw), -np.sin(cpm.pose.yaw)), (np.sin(cpm.pose.yaw), np.cos(cpm.pose.yaw))))
        objects = find_all(frame["its"], "cpm.PerceivedObject_element")
        assert len(objects) == len(cpm.objects.ids)
        for i, one in enumerate(objects):
            x, y = (int(one[f"cpm.{axis}Distance_element"]["cpm.value"]) / 100 for axis in "xy")
            place = front + turn @ (x, y)
            assert np.hypot(*(place - (cpm.objects.x[i], cpm.objects.y[i]))) < 0.01
            speeds = turn @ [int(find_all(one[f"cpm.{axis}Speed_element"], "cpm.value")[0]) / 100 for axis in "xy"]
            yaw = cpm.objects.yaw[i]
            assert np.allclose(speeds, cpm.objects.speed[i] * np.array((np.cos(yaw), np.sin(yaw))), atol=0.011)
            sizes = [int(one[f"cpm.planarObjectDimension{n}_element"]["cpm.value"]) / 10 for n in (1, 2)]
            assert np.allclose(sizes, (cpm.objects.length[i], cpm.objects.width[i]), atol=0.051)
            assert ("cpm.dynamicStatus" in one) == (cpm.objects.kind[i] == Kind.STATIC)
            count += 1
    assert count > 20


def test_tshark_reads_denms(talk_recording: ScoredRecording, tmp_path: Path) -> None:
    """An event and its cancellation, sent by CAV 0 at the end of the recording."""
    pose = ReferencePose(5.0, -3.0, 0.1, 40, 0.2, 0.01)
    event = Denm(pose, 7, EventCause.STATIONARY_VEHICLE, 2, 10.0, -3.0, 20, 4.0, 0.5, 4.9, 2.0)
    ended = replace(event, termination=Termination.CANCELLATION)
    sent = tuple(SentMessage(replace(encode(one), sender="0", tick=40), {}) for one in (event, ended))
    write_pcap([replace(talk_recording, record=replace(talk_recording.record, messages=sent))], tmp_path)
    capture = tmp_path / f"{SCENARIO}.pcap"
    assert read_with_tshark(capture, "-Y", "_ws.malformed || _ws.expert || data") == ""
    fields = ("btpb.dstport", "its.sequenceNumber", "its.causeCode", "denm.termination")
    shown = read_with_tshark(capture, "-T", "fields", *(word for name in fields for word in ("-e", name)))
    assert [line.split("\t") for line in shown.splitlines()] == [
        ["2002", "7", "94", ""],
        ["2002", "7", "", "0"],
    ]


def test_the_same_recording_gives_the_same_file(talk: StoredRun, capture: Path, tmp_path: Path) -> None:
    again = export_runs([talk], "pcap", tmp_path / "out") / capture.name
    assert again.read_bytes() == capture.read_bytes()


def test_a_run_without_such_messages_gets_one_sentence(run_folder: Path, tmp_path: Path) -> None:
    done = invoke("export", run_folder, "--format", "pcap", "--out", tmp_path / "out")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "expected a recording with CAMs, CPMs or DENMs that were transmitted, found" in done.stderr
    assert " text" in done.stderr and not (tmp_path / "out").exists()
