"""Which road users stand after a contact."""

from mdrive_sumo.core.state import Actors, Contact, EgoState, Frame, Kind
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
