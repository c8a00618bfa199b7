"""Settings of the channel: what is refused, how they are written and read, presets, and the options of commands."""

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import click
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.cli import main
from mdrive_sumo.cli.setting_options import episode_options, parse_comm_options, read_episode_options
from mdrive_sumo.core.clock import Clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.v2x.comm_settings import (
    PER,
    PRESETS,
    CommSettings,
    LinkSettings,
    describe_comm,
    format_comm_json,
    parse_comm,
)
from mdrive_sumo.v2x.messages import TYPES
from mdrive_sumo.v2x.radio.radio_settings import CornerModel, RadioProfile, RadioSettings
from mdrive_sumo.v2x.services.sending_rate import SendingRate


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"latency_ticks": -1}, "latency_ticks: expected a whole number"),
        ({"latency_ticks": 1.5}, "latency_ticks"),
        ({"latency_ticks": 10_001}, "10000"),
        ({"loss": -0.1}, r"loss: expected a probability in \[0, 1\], found -0.1"),
        ({"loss": 1.1}, "loss"),
        ({"loss": math.nan}, "loss"),
        ({"range_m": 0.0}, "range_m: expected a distance above 0 m"),
        ({"range_m": math.nan}, "range_m"),
        ({"pose_error_m": -1.0}, "pose_error_m: expected a finite standard deviation"),
        ({"pose_error_m": math.inf}, "pose_error_m"),
        ({"pose_error_deg": math.nan}, "pose_error_deg"),
        ({"pose_error_per": "tick"}, "one of message, episode"),
    ],
)
def test_unusable_links_are_refused(wrong: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why):
        LinkSettings(**wrong)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"budget_bytes_s": 0.0}, "budget_bytes_s: expected a number of bytes above 0"),
        ({"budget_bytes_s": math.nan}, "budget_bytes_s"),
        ({"header_bytes": -1}, "header_bytes"),
        ({"header_bytes": 65536}, "header_bytes"),
        ({"on": 1}, "on: expected true or false"),
        (
            {"by_type": {"vam": LinkSettings()}},
            "'vam', expected one of cam, cpm, mcm, denm, feature, text",
        ),
        *(
            ({"mute": (pattern,)}, "mute: expected SENDER/TYPE")
            for pattern in ("", "a", "a/", "/cam", "a/b/c", "a/b@x")
        ),
        ({"mute": ("a/cam@1.5",)}, "mute"),
        ({"mute": ("two words/cam",)}, "mute"),
    ],
)
def test_unusable_channels_are_refused(wrong: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why):
        CommSettings(**wrong)


positive = st.floats(0.001, 1e6) | st.just(math.inf)
links = st.builds(
    LinkSettings,
    st.integers(0, 10_000),
    st.floats(0, 1),
    positive,
    st.floats(0, 10),
    st.floats(0, 10),
    st.sampled_from(PER),
)
patterns = st.sampled_from(["*/*", "cav_1/cam", "*/text@7", "rsu-2/*@*", "a.b/my_type@12"])
comms = st.builds(
    CommSettings,
    preset=st.sampled_from(list(PRESETS)),
    on=st.booleans(),
    link=links,
    by_type=st.dictionaries(st.sampled_from(TYPES), links).map(MappingProxyType),
    budget_bytes_s=positive,
    header_bytes=st.integers(0, 65535),
    mute=st.lists(patterns, max_size=3).map(tuple),
)


@given(comms)
def test_described_and_comm_from_are_inverses(comm: CommSettings) -> None:
    told = describe_comm(comm)
    assert parse_comm(told) == comm
    assert all(type(value) in (str, int, float, bool) and value != math.inf for value in told.values())
    assert parse_comm(json.loads(format_comm_json(comm))) == comm
    assert format_comm_json(parse_comm(json.loads(format_comm_json(comm)))) == format_comm_json(comm)


def test_numbers_may_come_back_as_whole_or_as_floating() -> None:
    assert parse_comm({"latency_ticks": 6.0, "loss": 1}).link == LinkSettings(latency_ticks=6, loss=1.0)


def test_what_is_left_out_is_ideal() -> None:
    assert parse_comm({}) == CommSettings() == PRESETS["ideal"]


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"delay": 1}, "unknown option 'delay'"),
        ({"cam.budget_bytes_s": 1}, "unknown option 'cam.budget_bytes_s'"),
        ({".loss": 0.5}, "unknown option '.loss'"),
        ({"vam.loss": 0.5}, "unknown type of message 'vam'"),
        ({"preset": "perfect"}, "unknown preset 'perfect'"),
        ({"preset": 3}, "preset: expected a text"),
        ({"on": "yes"}, "on: expected true or false"),
        ({"latency_ticks": 1.5}, "latency_ticks: expected a whole number"),
        ({"latency_ticks": True}, "latency_ticks: expected a whole number"),
        ({"loss": "0.1"}, "loss: expected a finite number"),
        ({"range_m": math.inf}, "range_m: expected a finite number"),
        ({"range_m": -5}, "range_m: expected a distance"),
        ({"mute": "nonsense"}, "mute"),
    ],
)
def test_unusable_values_are_refused(values: Mapping[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why):
        parse_comm(values)


def test_presets_carry_their_own_names() -> None:
    assert {name: comm.preset for name, comm in PRESETS.items()} == {name: name for name in PRESETS}
    assert set(PRESETS) == {"ideal", "off", "paper-latency", "paper-pose", "realistic", "its-g5", "lte-v2x"}


def test_only_the_preset_off_is_off() -> None:
    assert [name for name, preset in PRESETS.items() if not preset.on] == ["off"]


def test_presets_of_the_paper_have_its_figures() -> None:
    assert PRESETS["paper-latency"].link == LinkSettings(latency_ticks=6)  # 300 ms
    assert PRESETS["paper-pose"].link == LinkSettings(pose_error_m=0.6, pose_error_deg=0.6)


def test_the_realistic_preset_has_the_figures_of_its_sources() -> None:
    realistic = PRESETS["realistic"]
    assert realistic.link == LinkSettings(latency_ticks=2, loss=0.1, range_m=150.0)
    assert realistic.budget_bytes_s == 0.03 * 6e6 / 8
    assert realistic.header_bytes == 38 + 40 + 4 + 95 + 30


def test_options_override_the_preset() -> None:
    comm = parse_comm_options("realistic", comm_loss="0", comm_budget="inf", comm_mute=("*/text",))
    expected = LinkSettings(latency_ticks=2, range_m=150.0)
    assert comm == replace(PRESETS["realistic"], link=expected, budget_bytes_s=math.inf, mute=("*/text",))


def test_nothing_given_is_the_preset() -> None:
    assert all(parse_comm_options(name, comm_loss=None, pose_error=None) == comm for name, comm in PRESETS.items())


@pytest.mark.parametrize(
    ("options", "everywhere", "of_types"),
    [
        ({"comm_latency": "6"}, LinkSettings(6), {}),
        ({"comm_latency": "cpm=6,mcm=2"}, LinkSettings(), {"cpm": LinkSettings(6), "mcm": LinkSettings(2)}),
        ({"comm_latency": "6,text=20"}, LinkSettings(6), {"text": LinkSettings(20)}),
        ({"comm_latency": "6 , text = 20"}, LinkSettings(6), {"text": LinkSettings(20)}),
        ({"comm_loss": "0.1,cam=0"}, LinkSettings(loss=0.1), {"cam": LinkSettings()}),
        (
            {"comm_range": "200,cpm=70,cam=inf"},
            LinkSettings(range_m=200),
            {"cpm": LinkSettings(range_m=70), "cam": LinkSettings()},
        ),
        ({"pose_error": "0.6,0.5"}, LinkSettings(pose_error_m=0.6, pose_error_deg=0.5), {}),
        ({"pose_error": "0.6,0,episode"}, LinkSettings(pose_error_m=0.6, pose_error_per="episode"), {}),
        (
            {"pose_error": "0.6,0.6,cam=0,0,cpm=1,2,episode"},
            LinkSettings(pose_error_m=0.6, pose_error_deg=0.6),
            {"cam": LinkSettings(), "cpm": LinkSettings(pose_error_m=1, pose_error_deg=2, pose_error_per="episode")},
        ),
        # Options of a type and of all types meet: a setting of all types leaves the values of single types.
        ({"comm_latency": "cpm=6", "comm_loss": "0.5"}, LinkSettings(loss=0.5), {"cpm": LinkSettings(6, 0.5)}),
        ({"comm_loss": "0.5", "comm_latency": "cpm=6"}, LinkSettings(loss=0.5), {"cpm": LinkSettings(6, 0.5)}),
    ],
)
def test_values_for_all_types_and_for_some(
    options: dict[str, Any], everywhere: LinkSettings, of_types: dict[str, LinkSettings]
) -> None:
    comm = parse_comm_options(**options)
    assert (comm.link, dict(comm.by_type)) == (everywhere, of_types)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"comm": "perfect"}, "--comm: expected one of ideal, off"),
        ({"comm_latency": "-1"}, "--comm-latency -1: expected a whole number of ticks, found '-1'"),
        ({"comm_latency": "1.5"}, "--comm-latency 1.5: expected a whole number"),
        ({"comm_latency": "99999"}, "latency_ticks: expected a whole number of ticks from 0 to 10000"),
        ({"comm_latency": ""}, "expected a whole number"),
        ({"comm_latency": "6,7"}, "expected a whole number"),
        ({"comm_latency": "cam=6,cam=7"}, "each type of cam, cpm, mcm, denm, feature, text at most once, found 'cam'"),
        ({"comm_latency": "vam=6"}, "found 'vam'"),
        ({"comm_latency": "=6"}, "found ''"),
        ({"comm_loss": "1.5"}, r"--comm-loss 1.5: loss: expected a probability in \[0, 1\]"),
        ({"comm_loss": "nan"}, "loss: expected a probability"),
        ({"comm_loss": "some"}, "expected a number, found 'some'"),
        ({"comm_loss": "0.1,0.2"}, "expected one number"),
        ({"comm_range": "0"}, "--comm-range 0: range_m: expected a distance above 0 m"),
        ({"comm_budget": "-5"}, "--comm-budget -5: budget_bytes_s: expected"),
        ({"comm_budget": "cam=5"}, "expected a number, found 'cam=5'"),
        ({"pose_error": "0.6"}, "expected POS_M,ROT_DEG or POS_M,ROT_DEG,episode"),
        ({"pose_error": "0.6,0.6,day"}, "expected POS_M,ROT_DEG"),
        ({"pose_error": "-1,0"}, "pose_error_m: expected a finite standard deviation"),
        ({"comm_mute": ("cam",)}, "mute: expected SENDER/TYPE"),
        ({"comm_power": "20"}, "--comm-power 20: expected a radio, --comm its-g5 or lte-v2x, found --comm ideal"),
        ({"comm": "realistic", "connected_background": "0"}, "found --comm realistic"),
        (
            {"comm": "its-g5", "comm_power": "-3"},
            "power_dbm: expected a transmit power from 0 to 33 dBm .*, found -3.0",
        ),
        ({"comm": "its-g5", "comm_power": "nan"}, "power_dbm: expected a transmit power"),
        ({"comm": "its-g5", "comm_power": "much"}, "expected a number, found 'much'"),
        ({"comm": "lte-v2x", "comm_gain": "30"}, "antenna_gain_dbi: expected a gain from -20 to 20 dBi, found 30.0"),
        ({"comm": "lte-v2x", "connected_background": "1.3"}, r"connected_background: expected a share in \[0, 1\]"),
        ({"comm": "lte-v2x", "comm_corner": "ray"}, "expected one of tr-37.885, virtual-source, found 'ray'"),
    ],
)
def test_unusable_options_are_refused_in_one_sentence(options: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why) as caught:
        parse_comm_options(**options)
    assert "\n" not in str(caught.value)


RADIO = {"comm": "lte-v2x", "comm_power": "20", "comm_gain": "0", "connected_background": "0.3"}


def test_a_radio_is_written_and_read_with_all_its_settings_and_no_other_channel_names_one() -> None:
    comm = parse_comm_options(**RADIO, comm_corner="virtual-source", comm_loss="0.1")
    assert comm.radio == RadioSettings(RadioProfile.LTE_V2X, 20.0, 0.0, 0.3, CornerModel.VIRTUAL_SOURCE)
    assert parse_comm(json.loads(format_comm_json(comm))) == comm
    assert describe_comm(comm)["radio.connected_background"] == 0.3
    others = [describe_comm(comm) for comm in PRESETS.values() if comm.radio is None]
    assert not any(name.startswith("radio") for described in others for name in described)


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"radio.profile": "wifi"}, "radio.profile: expected one of its-g5, lte-v2x, found 'wifi'"),
        ({"radio.power_dbm": 20.0}, "radio.profile: expected one of its-g5, lte-v2x, found none"),
        ({"radio.profile": "its-g5", "radio.colour": 1.0}, "unknown option 'radio.colour'"),
        ({"radio.profile": "its-g5", "radio.power_dbm": "20"}, "radio.power_dbm: expected a finite number, found '20'"),
        ({"radio.profile": "its-g5", "radio.power_dbm": 99.0}, "power_dbm: expected a transmit power"),
    ],
)
def test_an_unusable_radio_in_a_file_is_refused(values: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why):
        parse_comm(values)


def parsed(*arguments: str) -> tuple[Any, ...]:
    """What a command with these options makes of its command line; what it leaves for others comes last."""
    found: list[tuple[Any, ...]] = []

    @click.command()
    @episode_options
    @click.option("--other", default=3)
    def command(**options: Any) -> None:
        found.append((read_episode_options(options), options))

    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return found[0]


def test_a_command_takes_its_channel_and_its_clock_out_of_its_options() -> None:
    assert parsed() == (EpisodeOptions(), {"other": 3})
    mutes = ("--comm-mute", "a/cam", "--comm-mute", "*/text@7")
    options, _ = parsed("--comm", "paper-latency", "--pose-error", "0.6,0.6", "--agent-clock", "fixed:100", *mutes)
    assert options.comm.link == LinkSettings(latency_ticks=6, pose_error_m=0.6, pose_error_deg=0.6)
    assert (options.comm.preset, options.comm.mute, options.clock) == (
        "paper-latency",
        ("a/cam", "*/text@7"),
        Clock("fixed", 2),
    )


def test_on_a_radio_stations_send_by_etsis_rules_unless_told_otherwise() -> None:
    assert parsed("--comm", "its-g5")[0].v2x_rate is SendingRate.ETSI
    assert parsed("--comm", "its-g5", "--v2x-rate", "fixed")[0].v2x_rate is SendingRate.FIXED
    assert parsed("--comm", "realistic")[0].v2x_rate is SendingRate.FIXED
    options = EpisodeOptions.parse(comm="lte-v2x")
    assert options.v2x_rate is SendingRate.ETSI
    assert EpisodeOptions.from_dict(options.to_dict()) == options


@pytest.mark.parametrize(
    "arguments",
    [
        ("--comm", "perfect"),
        ("--comm-loss", "2"),
        ("--comm-mute", "cam"),
        ("--comm", "its-g5", "--connected-background", "2"),
        ("--agent-clock", "sometimes"),
        ("--agent-clock", "fixed:30"),
    ],
)
def test_eval_ends_with_one_sentence_and_exit_code_2(arguments: tuple[str, ...]) -> None:
    result = CliRunner().invoke(main, ["eval", *arguments])
    assert result.exit_code == 2
    assert result.output.startswith("Error: ") and result.output.count("\n") == 1
