"""Labels follow from what the CAVs exchanged and from facts about the agent, never from its own words."""

from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from testing.score_golden import ego, scenario
from testing.short_suite import make_short_suite

from mdrive_sumo.cli import main
from mdrive_sumo.contract import Message
from mdrive_sumo.episode import load_episode
from mdrive_sumo.scoring import ScenarioResult, load_results, make_void_result
from mdrive_sumo.scoring.labels import COMMUNICATION_LABELS, derive_communication_label, derive_labels
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage
from mdrive_sumo.v2x.message_counts import count_exchanged

TYPES = st.sets(st.sampled_from(("cam", "cpm", "mcm", "text", "gossip")))
FACTS = st.lists(st.sampled_from(("joint", "privileged", "unsandboxed", *COMMUNICATION_LABELS)), unique=True)


def result(*types: str) -> ScenarioResult:
    empty = make_void_result(scenario(ego("0")), 0, "")
    return empty.model_copy(update={"exchanged": dict.fromkeys(types, 3)})


@pytest.mark.parametrize(
    ("facts", "exchanged", "labels"),
    [
        ((), [(), ()], ("single",)),
        (("single",), [(), ("cam",)], ("sharing",)),
        (("single",), [("cam", "cpm")], ("sharing",)),
        (("single",), [("cam",), ("text",)], ("negotiation",)),
        (("sharing",), [("mcm",)], ("negotiation",)),
        (("sharing",), [("gossip",)], ("negotiation",)),
        (("negotiation",), [()], ("single",)),
        (("unsandboxed",), [()], ("single", "unsandboxed")),
        (("privileged",), [()], ("privileged",)),
        (("privileged",), [("mcm",)], ("negotiation", "privileged")),
        (("joint", "unsandboxed"), [("mcm",)], ("joint", "unsandboxed")),
        (("negotiation", "joint"), [()], ("joint",)),
    ],
)
def test_a_label_says_what_was_done(
    facts: tuple[str, ...], exchanged: list[tuple[str, ...]], labels: tuple[str, ...]
) -> None:
    assert derive_labels(facts, [result(*types) for types in exchanged]) == labels


@given(facts=FACTS, types=st.lists(TYPES, min_size=1, max_size=4))
def test_deriving_twice_is_deriving_once_and_more_messages_never_lower_a_label(
    facts: list[str], types: list[set[str]]
) -> None:
    results = [result(*sorted(kinds)) for kinds in types]
    labels = derive_labels(facts, results)
    assert derive_labels(labels, results) == labels
    assert {"joint", "privileged", "unsandboxed"} & set(facts) == {*labels} - {*COMMUNICATION_LABELS}
    rank = [COMMUNICATION_LABELS.index(derive_communication_label(kinds)) for kinds in types]
    assert COMMUNICATION_LABELS.index(derive_communication_label(set[str]().union(*types))) == max(rank)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(("0", "1", "rsu")),
            st.sampled_from(("cam", "mcm")),
            st.lists(st.sampled_from(tuple(DeliveryStatus)), max_size=3),
        )
    )
)
def test_only_what_a_cav_sent_and_another_received_counts(sent: list[tuple[str, str, list[DeliveryStatus]]]) -> None:
    messages = [
        SentMessage(Message(kind, b"", sender, 0), {str(i): (status, 1) for i, status in enumerate(fates)})
        for sender, kind, fates in sent
    ]
    expected: dict[str, int] = {}
    for sender, kind, fates in sent:
        if sender != "rsu" and "delivered" in fates:
            expected[kind] = expected.get(kind, 0) + 1
    assert count_exchanged(messages, ("0", "1")) == expected


LIAR = """
from pathlib import Path
from mdrive_sumo.contract import Control, Message, Reply, SensorSpec
class Liar:
    label = "single"
    def __init__(self, config): ...
    def sensors(self):
        first = Path(__file__).with_name("asked")
        if first.exists(): return (SensorSpec(KIND),)
        first.touch()
        return ()
    def start(self, briefing): ...
    def act(self, seen):
        return Reply(control=Control(0.5, 0.0, 0.0), messages=(Message("my-own", b"you go first"),))
"""


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("comm", "label", "kind", "track"),
    [("ideal", "negotiation", "objects", "object"), ("off", "single", "gnss", "sensor")],
)
def test_labels_and_track_follow_from_what_is_done_in_the_episodes(
    comm: str, label: str, kind: str, track: str, tmp_path: Path
) -> None:
    """The agent calls itself single, and declares its sensor only where it drives."""
    (tmp_path / "liar.py").write_text(LIAR.replace("KIND", repr(kind)))
    words = [
        "--suite",
        str(make_short_suite(tmp_path / "suite", "i01_*")),
        "--agent",
        f"{tmp_path}/liar.py:Liar",
        "--comm",
        comm,
        "--workers",
        "1",
    ]
    ended = CliRunner().invoke(main, ["eval", *words, "--out", str(tmp_path / "run")])
    assert ended.exit_code == 0, ended.output
    results = load_results(tmp_path / "run" / "results.json")
    assert results.run.labels == (label, "unsandboxed")
    assert results.run.declared_label == "single"
    assert set(results.scenarios[0].exchanged) == ({"my-own"} if comm == "ideal" else set())
    assert f"[{label}, unsandboxed, {track} track]" in ended.output
    assert (results.run.sensing_track, results.scenarios[0].sensing_track) == (track, track)
    (recording,) = (tmp_path / "run" / "episodes").glob("*.npz")
    assert load_episode(recording).sensing_track == track


@pytest.mark.parametrize(
    ("mute", "agent", "text"),
    [
        ("nobody/cam", "sharing", "expected a sender among 0, 1, found 'nobody'"),
        ("*/gossip", "sharing", "expected a type among cam, cpm, mcm, denm, feature, text or *, found 'gossip'"),
        ("9/*@7", "sharing", "expected a sender among"),
    ],
)
def test_muting_what_does_not_exist_is_refused(mute: str, agent: str, text: str, tmp_path: Path) -> None:
    words = [
        "eval",
        "--suite",
        "interdrive@0",
        "--agent",
        agent,
        "--scenario",
        "i01_*",
        "--comm-mute",
        mute,
        "--out",
        str(tmp_path),
    ]
    ended = CliRunner().invoke(main, words)
    assert ended.exit_code == 2 and ended.output.count("\n") == 1
    assert f"Error: --comm-mute {mute}: " in ended.output and text.split(" among ")[0] in ended.output
