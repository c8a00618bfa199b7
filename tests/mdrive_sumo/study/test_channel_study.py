"""`study channel`: measures by hand, properties of counts, a study from the command line, bad input."""

import csv
import io
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.local_executor import run_in_process
from testing.mixed_run import drive_mixed_run
from testing.score_golden import ego, episode, lane, roads, scenario
from testing.short_suite import make_short_suite
from testing.study_samples import invoke

from mdrive_sumo.contract import Message, Objects
from mdrive_sumo.core.state import Actors, End, Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.study.channel.awareness import AwarenessCounts
from mdrive_sumo.study.channel.channel_files import compute_mean_s, find_late_s
from mdrive_sumo.study.channel.channel_load import ChannelLoads
from mdrive_sumo.study.channel.link_measures import NOTHING, LinkCounts, LinkGroup, Ring, add_counts, list_link_classes
from mdrive_sumo.v2x.channel import Delivery, DeliveryStatus, SentMessage
from mdrive_sumo.v2x.messages import Cam, Cpm, ReferencePose, encode
from mdrive_sumo.v2x.radio.path_loss import LinkClass
from mdrive_sumo.v2x.radio.radio_medium import AirLink, BusyRatio

TWO = scenario(ego("0"), ego("1", y=30.0), rsus=(RoadsideUnit(id="rsu", x=0.0, y=-50.0),))
"""CAV 0 drives along y = 0, CAV 1 along y = 30; a road-side unit stands at (0, -50)."""
CAMS = LinkGroup("any", "cam")
DELIVERED, LOST, GONE = DeliveryStatus.DELIVERED, DeliveryStatus.LOST, DeliveryStatus.GONE


def drive_two(ticks: int = 41, *messages: SentMessage, actors: Actors | None = None, last: int = 40) -> EpisodeRecord:
    """Both CAVs drive at 10 m/s, side by side; CAV 1 ends in the tick `last`."""
    rows = {name: [(tick / 2, y, 0.0, 10.0) for tick in range(ticks)] for name, y in (("0", 0.0), ("1", 30.0))}
    rows["1"] = rows["1"][: last + 1]
    recorded = episode(TWO, rows, {"0": End.ARRIVED, "1": End.ARRIVED}, actors=actors)
    return replace(recorded, messages=messages)


def sent(
    tick: int, sender: str, fates: Mapping[str, tuple[DeliveryStatus, int]], content: Message | None = None
) -> SentMessage:
    message = content or Message("cam", b"")
    deliveries = {receiver: Delivery(*fate) for receiver, fate in fates.items()}
    return SentMessage(Message(message.type, message.payload, sender, tick), deliveries)


def count_links(*messages: SentMessage, last: int = 40) -> LinkCounts:
    counts = LinkCounts()
    counts.add(drive_two(41, *messages, last=last), TWO)
    return counts


def test_reception_counts_pairs_in_rings_of_20_m() -> None:
    counts = count_links(
        sent(0, "0", {"1": (DELIVERED, 2)}),
        sent(2, "0", {"1": (LOST, 2)}),
        sent(4, "0", {"1": (DeliveryStatus.OUT_OF_RANGE, 4)}),
        sent(6, "rsu", {"0": (DELIVERED, 8), "1": (LOST, 8)}),  # 50.1 m and 80.1 m away
    )
    assert counts.transmitted == {Ring(CAMS, 1): 3, Ring(CAMS, 2): 1, Ring(CAMS, 4): 1}
    assert counts.received == {Ring(CAMS, 1): 1, Ring(CAMS, 2): 1}


@pytest.mark.parametrize("status", ["muted", "over-budget", "malformed", "off", "gone"])
def test_what_no_radio_sent_is_counted_by_status_only(status: str) -> None:
    counts = count_links(sent(0, "0", {"1": (DeliveryStatus(status), 0)}))
    assert not counts.transmitted and counts.statuses == {(CAMS, status): 1}


def test_gaps_and_ages_by_hand() -> None:
    """Received in ticks 2, 4 and 8 what was sent in 0, 2 and 6; CAV 1 ends in tick 10."""
    counts = count_links(
        sent(0, "0", {"1": (DELIVERED, 2)}),
        sent(2, "0", {"1": (DELIVERED, 4)}),
        sent(4, "0", {"1": (LOST, 4)}),
        sent(6, "0", {"1": (DELIVERED, 8)}),
        last=10,
    )
    assert counts.gaps[CAMS].tolist() == [0, 0, 1, 0, 1]
    # Ages in ticks 2 to 10: 2 3 2 3 4 5 2 3 4
    assert counts.ages[CAMS].tolist() == [0, 0, 3, 3, 2, 1]
    assert compute_mean_s(counts.ages[CAMS]) == pytest.approx(28 / 9 * 0.05)
    assert find_late_s(counts.ages[CAMS]) == pytest.approx(0.25)


def test_an_older_message_that_arrives_later_makes_nothing_newer() -> None:
    counts = count_links(sent(0, "0", {"1": (DELIVERED, 9)}), sent(4, "0", {"1": (DELIVERED, 6)}), last=10)
    assert counts.ages[CAMS].tolist() == [0, 0, 1, 1, 1, 1, 1]


def test_types_and_senders_are_apart() -> None:
    """Texts and warnings come when something happens: they have neither gaps nor ages."""
    beacon, text, warning = (Message(kind, b"") for kind in ("beacon", "text", "denm"))
    fates = {"1": (DELIVERED, 2)}
    of_cav = [sent(0, "0", fates, content) for content in (None, beacon, text, warning)]
    counts = count_links(*of_cav, sent(0, "rsu", fates), last=2)
    assert sum(counts.received.values()) == 5
    assert counts.gaps == {}
    assert {group: found.tolist() for group, found in counts.ages.items()} == {
        CAMS: [0, 0, 2],
        LinkGroup("any", "beacon"): [0, 0, 1],
    }


@given(st.lists(st.integers(0, 9), max_size=5), st.lists(st.integers(0, 9), max_size=5))
def test_counts_add_up(first: Sequence[int], second: Sequence[int]) -> None:
    both = add_counts(*(np.array(values, dtype=np.int64) for values in (first, second)))
    assert both.sum() == sum(first) + sum(second) and len(both) == max(len(first), len(second))
    assert add_counts(NOTHING, both).tolist() == both.tolist()


@pytest.mark.parametrize(("counts", "mean", "late"), [([], None, None), ([0, 20], 0.05, 0.05), ([95, 0, 5], 0.005, 0)])
def test_means_and_late_times(counts: Sequence[int], mean: float | None, late: float | None) -> None:
    values = np.array(counts, dtype=np.int64)
    assert (compute_mean_s(values), find_late_s(values)) == (pytest.approx(mean), late)


def test_links_of_a_radio_are_apart_by_class() -> None:
    def over(link_class: LinkClass, message: SentMessage) -> SentMessage:
        return replace(message, links={"1": AirLink(link_class, -80)})

    counts = count_links(
        over(LinkClass.NLOSB, sent(0, "0", {"1": (DELIVERED, 1)})),
        over(LinkClass.NLOSB, sent(2, "0", {"1": (DeliveryStatus.LOST_PATH_LOSS, 2)})),
        over(LinkClass.LOS, sent(4, "0", {"1": (DELIVERED, 5)})),
        over(LinkClass.NLOSV, sent(6, "0", {"1": (DeliveryStatus.EXPIRED, 6)})),
        last=6,
    )
    behind_house, in_sight = LinkGroup("NLOSb", "cam"), LinkGroup("LOS", "cam")
    assert counts.transmitted == {Ring(behind_house, 1): 2, Ring(in_sight, 1): 1}
    assert counts.gaps.keys() == {in_sight} and counts.gaps[in_sight].tolist() == [0, 0, 0, 0, 1]
    # In ticks 1 to 4 the newest message came past a house, then in sight.
    assert counts.ages[behind_house].tolist() == [0, 1, 1, 1, 1] and counts.ages[in_sight].tolist() == [0, 1, 1]
    assert list_link_classes(ring.group for ring in counts.transmitted) == ["LOS", "NLOSb"]
    assert counts.statuses[LinkGroup("NLOSv", "cam"), "expired"] == 1


def test_busy_ratios_by_second() -> None:
    loads = ChannelLoads()
    assert (loads.list_seconds(), loads.compute_mean()) == ([], None)
    loads.add(BusyRatio(tick, station, tick / 100) for tick in (0, 10, 20) for station in "ab")
    first, second = loads.list_seconds()
    assert (first.second, first.measured, first.mean, first.highest) == (0, 4, pytest.approx(0.05), 0.1)
    assert (first.low, first.high) == (0.0, 0.1)
    assert (second.second, second.measured, second.mean) == (1, 2, 0.2)
    assert loads.compute_mean() == pytest.approx(0.1)


# ---- awareness

WALLED = replace(
    roads(lane("east", (-50, 0), (150, 0))),
    buildings=(Building(id="wall", polygon=((-60, 10), (160, 10), (160, 12), (-60, 12))),),
)
"""A wall between the roads of the two CAVs."""
WALKER = Actors(("walker",), np.array([Kind.PEDESTRIAN], np.uint8), *np.array([[5.0], [5.0], [0], [0], [0.5], [0.5]]))
"""Before the wall, where CAV 0 sees it."""


def tell_of_walker(x: float, y: float) -> Message:
    """A CPM of CAV 0 at tick 0 with one object there."""
    values = {"x": x, "y": y, "yaw": 0.0, "speed": 0.0, "length": 0.5, "width": 0.5}
    columns = {name: np.array([value]) for name, value in values.items()}
    seen = Objects(ids=("t00000001",), kind=np.array([Kind.PEDESTRIAN], np.uint8), **columns)
    return encode(Cpm(ReferencePose(0.0, 0.0, 0.0, 0), 80.0, seen, np.zeros(1, np.uint8)))


def count_awareness(*messages: SentMessage) -> dict[str, int]:
    """Counts of CAV 1 and 0 in ticks 0, 10, 20, 30 and 40: each has two relevant road users."""
    counts = AwarenessCounts()
    counts.add(drive_two(41, *messages, actors=WALKER), WALLED)
    return {name: getattr(counts, name).total() for name in ("relevant", "seen", "told", "known")}


def test_a_wall_hides_and_messages_tell() -> None:
    # CAV 0 sees the walker in five looks; behind the wall nobody sees anything.
    assert count_awareness() == {"relevant": 20, "seen": 5, "told": 0, "known": 5}
    # A CAM that arrives in tick 2 is fresh in ticks 10 and 20.
    cam = encode(Cam(ReferencePose(0.0, 0.0, 0.0, 0), 10.0, 0.0, 0.0, 4.9, 2.0))
    told = count_awareness(sent(0, "0", {"1": (DELIVERED, 2)}, cam))
    assert told == {"relevant": 20, "seen": 5, "told": 2, "known": 7}
    assert count_awareness(sent(0, "0", {"1": (LOST, 2)}, cam))["told"] == 0


@pytest.mark.parametrize(("x", "told"), [(5.0, 4), (6.9, 4), (7.1, 2)])
def test_an_object_is_the_road_user_that_was_there(x: float, told: int) -> None:
    """Of its sender and, within 2 m, of the walker, in ticks 10 and 20."""
    assert count_awareness(sent(0, "0", {"1": (DELIVERED, 2)}, tell_of_walker(x, 5.0)))["told"] == told


def test_shares_of_nothing_are_undefined() -> None:
    assert AwarenessCounts().compute_ratio(Counter()) is None


# ---- the command


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of sharing over four channels, and one of CAVs that say nothing."""
    folder = tmp_path_factory.mktemp("channel")
    suite = make_short_suite(folder / "suite", "i11_ins_sl_town", metres=12)
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        for name, agent, comm in (
            ("lossy", "sharing", "realistic"),
            ("ideal", "sharing", "ideal"),
            ("silent", "single", "ideal"),
            ("off", "sharing", "off"),
            ("radio", "sharing", "its-g5"),
        ):
            words = ("--agent", agent, "--comm", comm, "--workers", "1", "--out", folder / name)
            assert invoke("eval", "--suite", suite, *words).exit_code == 0
    return folder


@pytest.mark.slow
def test_a_study_from_the_command_line(driven: Path, tmp_path: Path) -> None:
    done = invoke("study", "channel", driven / "lossy", driven / "ideal", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    names = {path.name for path in (tmp_path / "out").iterdir()}
    stems = {"reception", "gaps", "ages", "awareness"}
    assert names == {f"{stem}.{kind}" for stem in stems for kind in ("csv", "png", "svg")} | {
        "channel.json",
        "channel.md",
    }
    page = json.loads((tmp_path / "out" / "channel.json").read_text())
    lossy, ideal = page["summary"]
    assert (lossy["run"], ideal["run"]) == ("sharing, realistic", "sharing, ideal")
    assert 80 < lossy["received"] < 97 and ideal["received"] == 100
    assert lossy["age"] > ideal["age"] and ideal["known"] >= ideal["seen"] > 0
    rows = list(csv.DictReader(io.StringIO((tmp_path / "out" / "reception.csv").read_text())))
    assert sum(int(row["transmitted"]) for row in rows if row["run"] == "sharing, realistic") == lossy["deliveries"]


@pytest.mark.slow
def test_a_study_of_a_radio_has_its_load_and_classes(driven: Path, tmp_path: Path) -> None:
    done = invoke("study", "channel", driven / "radio", driven / "ideal", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    rows = list(csv.DictReader(io.StringIO((tmp_path / "out" / "busy.csv").read_text())))
    assert {row["run"] for row in rows} == {"sharing, its-g5"} and float(rows[1]["mean"]) > 0
    assert (tmp_path / "out" / "busy.png").stat().st_size > 0
    summary = json.loads((tmp_path / "out" / "channel.json").read_text())["summary"]
    classes = {row["class"] for row in summary if row["run"] == "sharing, its-g5"}
    assert {"all", "LOS", "NLOSb"} <= classes
    assert summary[0]["busy"] > 0 and summary[-1]["busy"] is None
    radio, ideal = (json.loads((driven / name / "results.json").read_text()) for name in ("radio", "ideal"))
    load = radio["scenarios"][0]["busy_ratio"]
    assert 0 < load["mean"] <= load["greatest"] < 0.1 and "busy_ratio" not in ideal["scenarios"][0]
    assert "- channel busy ratio at the CAVs: mean 0.0" in (driven / "radio" / "report.md").read_text()


BAD_INPUT = [
    (("silent",), "silent: expected at least one message that was transmitted to another station, found no message"),
    (("off",), "off: expected at least one message that was transmitted to another station, found"),
    (("lossy", "lossy"), "study channel: expected different runs, found"),
    (("lossy", "--scenario", "i99"), "expected an id, category or glob of its 1 scenarios, found 'i99'"),
    (("nowhere",), "nowhere"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("words", "sentence"), BAD_INPUT)
def test_bad_input_gets_one_sentence(driven: Path, tmp_path: Path, words: tuple[str, ...], sentence: str) -> None:
    given_words = [word if word.startswith(("--", "i99")) else driven / word for word in words]
    done = invoke("study", "channel", *given_words, "--out", tmp_path / "out")
    assert done.exit_code == 2 and sentence in done.stderr
    assert "Traceback" not in done.output and not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_run_without_recordings_is_refused(in_process: None, tmp_path: Path) -> None:
    run = drive_mixed_run(tmp_path, "--no-record")
    done = invoke("study", "channel", run, "--out", tmp_path / "out")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "expected a run with recordings, found one made with --no-record" in done.stderr
