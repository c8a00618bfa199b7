"""`study ablate`: an episode without single senders, types and messages; references of `show`."""

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.journals import rewrite_journal
from testing.local_executor import TALKER
from testing.study_samples import invoke, make_scenario

from mdrive_sumo.contract import Control, Message
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Actors, EgoState, End, Frame
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, load_episode, quantize_frame
from mdrive_sumo.scoring import load_results
from mdrive_sumo.study.ablation import MuteEffect, choose_mutes, find_divergence_tick, rank_effects
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage
from mdrive_sumo.v2x.comm_settings import CommSettings, LinkSettings, format_comm_json

ABLATE = ("study", "ablate", "--trust-agent")
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]


def episode(xs: list[float], ids: tuple[str, ...] = ("0", "1")) -> EpisodeRecord:
    recorder = Recorder("s", {}, dict.fromkeys(ids, (4.9, 2.0)))
    for tick, x in enumerate(xs):
        egos = {name: EgoState(x=x if name == ids[-1] else 0.0, y=0.0, yaw=0.0, speed=1.0) for name in ids}
        recorder.add(quantize_frame(Frame(tick, egos, Actors.empty(), {})), dict.fromkeys(ids, PEDAL), {}, {})
    return recorder.finish([Ending(ego, len(xs) - 1, End.ARRIVED) for ego in ids])


PEDAL = Control(throttle=0.5, brake=0.0, steer=0.0)


@given(tick=st.integers(0, 5))
def test_episodes_diverge_at_the_first_different_position(tick: int) -> None:
    same = [float(i) for i in range(6)]
    moved = [x + 0.01 * (i >= tick) for i, x in enumerate(same)]
    assert find_divergence_tick(episode(same), episode(moved)) == tick
    assert find_divergence_tick(episode(same), episode(same)) is None
    assert find_divergence_tick(episode(same), episode(same[:4])) == 4
    assert find_divergence_tick(episode(same), episode(same, ("0", "2"))) == 0


def sent(sender: str, kind: str, tick: int, fate: DeliveryStatus = DeliveryStatus.DELIVERED) -> SentMessage:
    return SentMessage(Message(kind, b"", sender, tick), {"z": (fate, tick)})


SAID = (sent("0", "cam", 1), sent("1", "cpm", 1), sent("0", "cam", 2), sent("0", "cam", 2), sent("r", "cpm", 3),
        sent("0", "text", 3, DeliveryStatus.LOST))  # fmt: skip


def test_what_is_muted_without_a_wish_is_every_sender_and_every_type_that_was_heard() -> None:
    assert choose_mutes(SAID, ()) == ("0/*", "1/*", "r/*", "*/cam", "*/cpm")
    assert choose_mutes(SAID, ("0/text", "0/text", "*/*@2")) == ("0/text", "*/*@2")
    assert choose_mutes(SAID, (), "cam") == ("0/cam@1", "0/cam@2")
    assert choose_mutes(SAID, ("r/*",), "cpm") == ("r/*", "1/cpm@1", "r/cpm@3")


@pytest.mark.parametrize(
    ("choice", "sentence"),
    [
        (((), "cam", 1), "expected at most 1 runs, found 2; --max-runs 2 allows them"),
        (((), "text"), "expected a type of message that reached a receiver, found 'text'"),
        ((("9/*",),), "expected a pattern that fits a message, found '9/\\*'"),
        ((("9",),), "mute: expected SENDER/TYPE"),
    ],
)
def test_what_cannot_be_muted_is_one_sentence(choice: tuple[object, ...], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        choose_mutes(SAID, *choice)
    for said in ((), SAID[-1:]):
        with pytest.raises(InputError, match="found no"):
            choose_mutes(said, ())


def test_the_largest_effect_comes_first() -> None:
    def effect(name: str, ds: float, ttc: float | None, parted: int | None) -> MuteEffect:
        return MuteEffect((name,), 1, make_scenario("a", ds, min_ttc=ttc), parted, "")

    effects = [
        effect("none", 50, 1.0, None),
        effect("late", 50, 1.0, 9),
        effect("early", 50, 1.0, 3),
        effect("close", 50, 0.5, 9),
        effect("never", 50, None, 9),  # 1.8 s or more
        effect("better", 60, None, 9),
        effect("worse", 10, 1.0, 9),
    ]
    found = rank_effects(make_scenario("a", 50, min_ttc=1.0), effects)
    assert [one.mute[0] for one in found.effects] == ["worse", "better", "never", "close", "early", "late", "none"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("talk") / "run"
    ended = invoke(
        "eval", "--suite", "interdrive@0", "--scenario", "i02_*", "--agent", TALKER, "--workers", 1, "--out", folder
    )
    assert ended.exit_code == 0, ended.output
    return folder


def test_an_episode_without_single_senders(finished: Path) -> None:
    ended = invoke(*ABLATE, finished, "--json", "--workers", 1)
    assert ended.exit_code == 0, ended.output
    page = json.loads(ended.stdout)
    found = {effect["mute"][0]: effect for effect in page["effects"]}
    senders = sorted({sent.message.sender for sent in recorded(finished).messages})
    assert set(found) == {*(f"{sender}/*" for sender in senders), "*/text"}
    assert all(effect["parted"] == 2 for effect in found.values())  # said in tick 0, heard in 1, somewhere else in 2
    assert found["*/text"]["messages"] == sum(found[f"{sender}/*"]["messages"] for sender in senders)
    changes = [abs(effect["ds_change"]) for effect in page["effects"]]
    assert changes == sorted(changes, reverse=True) and changes[0] > 0
    silent = invoke(
        "eval",
        "--suite",
        "interdrive@0",
        "--scenario",
        "i02_*",
        "--agent",
        TALKER,
        "--comm",
        "off",
        "--out",
        finished.parent / "off",
    )
    assert silent.exit_code == 0
    alone = load_results(finished.parent / "off" / "results.json").scenarios[0]
    assert (found["*/text"]["ds"], found["*/text"]["digest"]) == (alone.ds, alone.digest)


def recorded(folder: Path) -> EpisodeRecord:
    return load_episode(next((folder / "episodes").glob("*.npz")))


def test_an_episode_without_one_message(finished: Path) -> None:
    ended = invoke(*ABLATE, finished, "--mute", "0/text@20", "--mute", "*/text@5000", "--workers", 1)
    assert ended.exit_code == 2 and "fits a message, found '*/text@5000'" in ended.stderr
    ended = invoke(*ABLATE, finished, "--mute", "0/text@20", "--workers", 1)
    assert ended.exit_code == 0, ended.output
    row = ended.stdout.splitlines()[-1].split()
    assert row[:2] == ["0/text@20", "1"] and row[-3:] == ["22", "(1.10", "s)"]


def test_nothing_is_told_of_a_recording_that_comes_out_differently(finished: Path, tmp_path: Path) -> None:
    """The journal's channel is changed: what is executed again is another run."""
    folder = tmp_path / "run"
    shutil.copytree(finished, folder)
    other = format_comm_json(CommSettings(link=LinkSettings(latency_ticks=9)))

    def change(line: str) -> str:
        values = json.loads(line)
        values.get("fingerprint", {})["comm"] = other
        return json.dumps(values)

    rewrite_journal(folder / "journal.jsonl", change)
    ended = invoke(*ABLATE, folder, "--workers", 1)
    assert ended.exit_code == 1
    assert "the recording itself comes out differently: tick 1: messages that arrive" in ended.stderr
    assert ended.stdout == ""


def test_without_a_recording_there_is_nothing_to_ablate(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished, tmp_path / "run")
    next((tmp_path / "run" / "episodes").glob("*.npz")).unlink()
    ended = invoke(*ABLATE, tmp_path / "run")
    assert ended.exit_code == 2 and "expected a recording of i02" in ended.stderr


def test_show_finds_or_drives_the_references(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plain = invoke("show", finished)
    assert plain.exit_code == 0 and "scenario mean" in plain.stdout and "captured" not in plain.stdout
    first = invoke("show", finished, "--captured", "--out", "report.md", "--workers", 1)
    assert first.exit_code == 0, first.output
    assert first.stderr.count("reference ") == 2 and "1/1" in first.stderr
    assert "captured [%]" in first.stdout and "captured [%]" in Path("report.md").read_text()
    again = invoke(
        "eval", "--suite", "interdrive@0", "--scenario", "i02_*", "--agent", TALKER, "--captured", "--workers", 1
    )
    assert again.exit_code == 0, again.output
    assert again.stderr.count("already complete") == 2  # the references of `show`
    rows = [text.splitlines()[3:7] for text in (first.stdout, again.stdout)]
    assert rows[0] == rows[1]
    journal = next(Path("runs").glob("*-off")) / "journal.jsonl"
    kept = journal.read_bytes()
    journal.write_text(journal.read_text().replace('"code":"sha256:', '"code":"sha256:0'))
    damaged = invoke("show", finished, "--captured")
    assert damaged.exit_code == 2 and "line 1: expected the checksum" in damaged.stderr
    assert damaged.stderr.endswith("; remove that folder to have it driven anew\n")
    journal.write_bytes(kept)
    rewrite_journal(journal, lambda line: line.replace('"code":"sha256:', '"code":"sha256:0'))
    stale = invoke("show", finished, "--captured")
    assert stale.exit_code == 2 and "another code" in stale.stderr
    assert stale.stderr.endswith("; remove that folder to have it driven anew\n")
    assert invoke("show", "i02_*", "--captured").exit_code == 2
