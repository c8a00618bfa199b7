"""A channel that is a radio: its statuses, what works on top of it, and what recordings keep of it."""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from testing.short_suite import make_short_suite

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode.episode_file import load_episode, save_episode
from mdrive_sumo.v2x.channel import Channel, DeliveryStatus
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, LinkSettings
from mdrive_sumo.v2x.message_counts import count_deliveries
from mdrive_sumo.v2x.messages import encode
from mdrive_sumo.v2x.radio.path_loss import LinkClass
from mdrive_sumo.v2x.radio.radio_scene import RadioScene

G5 = PRESETS["its-g5"]
PLACES: Mapping[str, tuple[float, float]] = {"a": (0.0, 0.0), "b": (40.0, 0.0), "c": (5000.0, 0.0)}


def make_scene(kind: LinkClass = LinkClass.NLOSB) -> RadioScene:
    classes, blocker = np.full((3, 3), kind, dtype=np.uint8), np.zeros((3, 3))
    return RadioScene(("a", "b", "c"), np.array([*PLACES.values()]), np.full(3, 1.5), np.zeros(0), classes, blocker)


def send(comm: CommSettings, size: int, ticks: int = 30) -> tuple[Channel, list[int]]:
    """Send a text of `size` bytes from `a` in tick 0; return the ticks in which `b` gets it."""
    channel, arrivals = Channel(comm, 1), list[int]()
    for tick in range(ticks):
        inbox = channel.deliver(tick, tuple(PLACES))
        arrivals += [tick] * len(inbox["b"])
        outgoing = {"a": (encode("x" * size),)} if tick == 0 else {}
        channel.send(tick, outgoing, PLACES, scene=make_scene())
    return channel, arrivals


def test_a_near_station_gets_a_message_and_a_far_one_does_not() -> None:
    channel, arrivals = send(G5, 100)
    assert arrivals == [1]
    (sent,) = channel.sent_messages()
    assert {name: status for name, (status, _) in sent.deliveries.items()} == {"b": "delivered", "c": "lost-path-loss"}
    assert sent.links["b"].link_class is LinkClass.NLOSB
    assert sent.links["b"].power_dbm > -90 > sent.links["c"].power_dbm
    counted = count_deliveries(channel.sent_messages())
    assert (counted["delivered"], counted["lost-path-loss"]) == (1, 1)
    assert "expired" not in counted


def test_what_the_radio_delivers_the_other_mechanisms_may_still_lose_or_delay() -> None:
    assert send(replace(G5, link=LinkSettings(latency_ticks=4)), 100)[1] == [4]
    channel, arrivals = send(replace(G5, link=LinkSettings(loss=1.0)), 100)
    assert arrivals == []
    assert channel.sent_messages()[0].deliveries["b"].status is DeliveryStatus.LOST
    assert (
        send(replace(G5, link=LinkSettings(range_m=30.0)), 100)[0].sent_messages()[0].deliveries["b"].status
        == "out-of-range"
    )
    muted, _ = send(replace(G5, mute=("a/text",)), 100)
    assert muted.sent_messages()[0].links == {}
    assert muted.list_busy_ratios() == ()
    assert send(replace(G5, on=False), 100)[1] == []


def test_lte_v2x_waits_for_its_resource() -> None:
    assert send(PRESETS["lte-v2x"], 100)[1] == [2]


def test_a_radio_without_a_scene_is_a_mistake_of_the_caller() -> None:
    with pytest.raises(ValueError, match="expected the scene of a radio"):
        Channel(G5, 1).send(0, {"a": (encode("hi"),)}, PLACES)


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_a_run_on_its_g5_from_the_command_line_to_its_recording(tmp_path: Path) -> None:
    """Same suite on `ideal` and on a weak, loaded radio: reasons in results, links and loads in recordings."""
    suite = make_short_suite(tmp_path / "suite", "i01*")

    def drive(folder: str, *options: str) -> Path:
        words = ("eval", "--suite", suite, "--agent", "sharing", "--workers", "1", "--out", tmp_path / folder, *options)
        ended = CliRunner().invoke(main, [str(word) for word in words])
        assert ended.exit_code == 0, ended.output
        return next((tmp_path / folder / "episodes").rglob("*.npz"))

    radio = ("--comm", "its-g5", "--comm-power", "0", "--comm-gain", "-20", "--connected-background", "1")
    ideal, weak, again = drive("ideal"), drive("weak", *radio), drive("again", *radio)
    assert weak.read_bytes() == again.read_bytes()
    episode = load_episode(weak)
    lost = [one for one in episode.messages for status, _ in one.deliveries.values() if status == "lost-path-loss"]
    assert lost
    assert all(one.links.keys() == one.deliveries.keys() for one in episode.messages)
    assert {entry.station for entry in episode.busy_ratios} == {*episode.ego_ids}
    assert load_episode(ideal).busy_ratios == ()
    assert "links" not in np.load(ideal).files
    results = json.loads((tmp_path / "weak" / "results.json").read_text("utf-8"))
    assert results["scenarios"][0]["comm"]["lost-path-loss"] == len(lost)
    assert results["run"]["comm"]["radio.power_dbm"] == 0.0
    verified = CliRunner().invoke(main, ["verify", str(tmp_path / "weak")])
    assert verified.exit_code == 0, verified.output

    arrays = dict(np.load(weak))
    arrays["links"][0, 0] = 9
    damaged = tmp_path / "damaged.npz"
    np.savez_compressed(damaged, **arrays)
    with pytest.raises(InputError, match="links: an unknown class"):
        load_episode(damaged)
    del arrays["links"]
    np.savez_compressed(damaged, **arrays)
    with pytest.raises(InputError, match="links and busy_ratios: expected both"):
        load_episode(damaged)
    save_episode(dataclasses.replace(episode), damaged)
    assert load_episode(damaged).busy_ratios == episode.busy_ratios
