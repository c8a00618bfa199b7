"""Which road users stand after a contact, and the complete states of CAVs."""

import pytest
from testing.worlds import EmptyWorld, straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import Actors, Contact, EgoState, Frame, Kind
from mdrive_sumo.loop import EpisodeConfig, SimulatedFrames
from mdrive_sumo.loop.frame_source import _find_struck


def test_what_a_cav_touches_stands_but_props_and_cavs() -> None:
    contacts = (
        Contact("0", "1", Kind.VEHICLE),
        Contact("0", "bg", Kind.VEHICLE),
        Contact("0", "cone", Kind.STATIC),
        Contact("1", "walker", Kind.PEDESTRIAN),
        Contact("1", "", Kind.STATIC),
    )
    egos = {"0": EgoState(0, 0, 0, 0), "1": EgoState(4.9, 0, 0, 0)}
    assert _find_struck(Frame(5, egos, Actors.empty(), {}, contacts)) == {"bg", "walker"}


def test_complete_states_belong_to_the_latest_frame() -> None:
    """What a page needs to compute the own car ahead; it cannot be changed from outside."""
    config = EpisodeConfig(straight_scenario(straight_ego("0")), straight_road(), 0)
    frames = SimulatedFrames(config, EmptyWorld())
    states = frames.vehicle_states
    frame = frames.start()
    for _ in range(10):
        frame = frames.advance(frame, {"0": Control(1.0, 0.0, 0.1)})
    state = states["0"]
    assert (state.x, state.y, state.vx) == (frame.egos["0"].x, frame.egos["0"].y, frame.egos["0"].speed)
    assert 0.5 < state.drive < 1.0 and state.steer_angle > 0.0
    with pytest.raises(TypeError):
        states["0"] = state  # type: ignore[index]
