"""Channel conditions of a study: one factor at a time, the whole grid, levels as they were written."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.study_samples import IDEAL

from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.study.conditions import (
    make_conditions,
    parse_levels,
    parse_pose_levels,
)
from mdrive_sumo.study.study_runs import name_agent_folder
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, LinkSettings
from mdrive_sumo.v2x.services.sending_rate import SendingRate


def test_one_factor_at_a_time_leaves_the_others_at_the_base() -> None:
    varied = {"latency": parse_levels("latency", "0,2,6"), "pose-error": parse_pose_levels("0,0.6", None)}
    found = make_conditions(IDEAL, varied, "one-at-a-time")
    assert [c.name for c in found] == ["base", "latency 2 ticks", "latency 6 ticks", "pose-error 0.6 m 0.6°"]
    assert found[0].comm == IDEAL
    assert found[2].comm.link == LinkSettings(latency_ticks=6)
    assert found[3].comm.link == LinkSettings(pose_error_m=0.6, pose_error_deg=0.6)


def test_the_whole_grid_has_every_combination_once() -> None:
    varied = {"latency": parse_levels("latency", "0,6"), "loss": parse_levels("loss", "0,0.3,1")}
    found = make_conditions(IDEAL, varied, "full")
    links = [(c.comm.link.latency_ticks, c.comm.link.loss) for c in found]
    assert sorted(links) == [(0, 0.0), (0, 0.3), (0, 1.0), (6, 0.0), (6, 0.3), (6, 1.0)]
    assert links[0] == (0, 0.0)
    assert len({c.folder for c in found}) == len(found)


def test_a_level_holds_for_every_type_of_message_and_replaces_what_types_had() -> None:
    base = CommSettings(link=LinkSettings(loss=0.1), by_type={"cpm": LinkSettings(loss=0.5, latency_ticks=3)})
    _, even, lossy = make_conditions(base, {"loss": parse_levels("loss", "0.1,0.4")}, "one-at-a-time")
    assert even.comm.by_type == {"cpm": LinkSettings(loss=0.1, latency_ticks=3)}
    assert (lossy.comm.link.loss, lossy.comm.by_type["cpm"].loss) == (0.4, 0.4)


def test_channels_stand_beside_levels_of_the_base_and_a_radio_has_a_load() -> None:
    base, busy, plain = make_conditions(
        PRESETS["its-g5"], {"connected-background": parse_levels("connected-background", "0.3")}, "one-at-a-time",
        channels=("ideal",),
    )  # fmt: skip
    assert [one.name for one in (base, busy, plain)] == ["base", "connected-background 0.3", "ideal"]
    assert base.comm.radio and busy.comm == replace(base.comm, radio=replace(base.comm.radio, connected_background=0.3))
    assert plain.comm == IDEAL


@pytest.mark.parametrize(("channel", "rate"), [("its-g5", SendingRate.ETSI), ("realistic", SendingRate.FIXED)])
def test_each_channel_has_the_rate_that_goes_with_it(channel: str, rate: SendingRate) -> None:
    for base in ("ideal", "lte-v2x"):
        assert EpisodeOptions.parse(comm=base).with_channel(PRESETS[channel]) == EpisodeOptions.parse(comm=channel)
    assert EpisodeOptions.parse(comm=channel).v2x_rate is rate


@given(st.lists(st.floats(0, 1), min_size=1, max_size=6, unique=True))
def test_levels_are_read_as_they_were_written_and_never_mixed_up(losses: list[float]) -> None:
    levels = parse_levels("loss", ",".join(map(repr, losses)))
    assert levels == tuple((loss,) for loss in losses)
    found = make_conditions(CommSettings(link=LinkSettings(loss=0.123)), {"loss": levels}, "one-at-a-time")
    assert {c.comm.link.loss for c in found} == {0.123, *losses}
    assert len({c.folder for c in found}) == len(found)


def test_folders_of_agents_differ_where_classes_have_one_name() -> None:
    assert name_agent_folder(AgentSpec("idm")) == "idm"
    names = [name_agent_folder(AgentSpec(f"/{folder}/x.py:Same")) for folder in "ab"]
    assert len(set(names)) == 2 and all(name.startswith("x_Same-") for name in names)
