"""Prompt texts: the task, the relations, and the rules in words."""

from collections.abc import Mapping

RULES_IN_WORDS: Mapping[str, str] = {
    "_check_topology": "topology is one of those that the category allows.",
    "_check_needs": "The four needs_* are exactly as the category has them.",
    "_check_ego_count": "ego_vehicles: as many as the category allows.",
    "_check_ego_ids": 'ego_vehicles have the ids "Vehicle 1", "Vehicle 2" and so on, in this order, without gaps.',
    "_check_actor_count": "actors: at most 8 together, quantities counted.",
    "_check_actor_ids": "Every actor_id occurs once.",
    "_check_known_ids": "a and b of every constraint, and affects_vehicle of every actor, are ids of ego_vehicles.",
    "_check_no_self_relation": "No constraint relates a vehicle to itself.",
    "_check_contradictions": "Constraints do not contradict one another: one vehicle comes from the approach of the"
    " other, or"
    " from the opposite one, or from its right, or from its left; and it is in the other's lane, or left of it, or"
    ' right of it. Mirrored ones count: "a left_lane_of b" is "b right_lane_of a"; so with perpendicular_right_of and'
    " perpendicular_left_of.",
    "_check_crossing_actors": "Only a walker or cyclist has the motion cross_perpendicular.",
    "_check_static_actors": "A static_prop or parked_vehicle has the motion static.",
    "_check_conflict_relation": "With more than one vehicle at least one constraint is opposite_approach_of,"
    " perpendicular_right_of,"
    " perpendicular_left_of, left_lane_of, right_lane_of, merges_into_lane_of or same_lane_as.",
    "_check_oncoming_relation": "needs_oncoming asks for an opposite_approach_of.",
    "_check_lane_relation": "needs_multi_lane asks for a left_lane_of, right_lane_of, same_lane_as or"
    " merges_into_lane_of.",
    "_check_merge_relation": "needs_merge and needs_on_ramp ask for a merges_into_lane_of.",
    "_check_ramp_roads": "needs_on_ramp asks for a vehicle with entry_road main and one with entry_road side.",
    "_check_unprotected_left": "unprotected-left: a vehicle that turns left is opposite_approach_of one that goes"
    " straight.",
    "_check_walkers": "crosswalk: at least one actor is a walker.",
    "_check_no_lane_change": "blocked-lane: no vehicle has the maneuver lane_change.",
    "_check_overtaking": "overtaking: an actor with motion static affects Vehicle 1, and Vehicle 2 is"
    " opposite_approach_of"
    " Vehicle 1.",
    "_check_typology": "pre_crash is the number of the NHTSA typology for the category pre-crash, and null for all"
    " others.",
}
"""The text of every rule of rules.py, by its name."""
ROLE = (
    "You design traffic scenarios that test how connected automated vehicles (CAVs) cooperate. A scenario is good if"
    " its CAVs and actors get in each other's way at about the same time, so that driving on blindly is dangerous while"
    " careful drivers who cooperate all get through. You say who does what and how they stand to each other; places,"
    " speeds and times are worked out from that on a map. Traffic keeps right."
)
TERMS: Mapping[str, str] = {
    "same_approach_as": "a enters by the road by which b enters",
    "same_road_as": "as same_approach_as",
    "opposite_approach_of": "a and b come towards each other",
    "perpendicular_right_of": "a comes from b's right",
    "perpendicular_left_of": "a comes from b's left",
    "same_exit_as": "a and b leave by the same road",
    "follow_route_of": "a takes the way of b, before or behind it",
    "left_lane_of": "a enters in the next lane to the left of b's",
    "right_lane_of": "a enters in the next lane to the right of b's",
    "merges_into_lane_of": "a enters in another lane than b and ends up in b's",
    "same_lane_as": "a and b enter in the same lane",
}
"""Meaning of the constraints, as route_assignment.py applies them."""
