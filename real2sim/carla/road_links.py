"""Repair OpenDRIVE roads that are linked on one side only: netconvert leaves a gap there (CARLA's Town03 of 2019)."""

from collections.abc import Iterator
from xml.etree import ElementTree

from real2sim.xml_file import Element

ENDS = {"start": "predecessor", "end": "successor"}
"""Contact point of a road -> the name of its link there."""
CONTACTS = {link: contact for contact, link in ENDS.items()}


def repair_road_links(root: Element) -> tuple[str, ...]:
    """Add missing back links to roads outside junctions, in place; return the changes."""
    roads = {road.get("id", ""): road for road in root.iter("road") if road.get("junction") == "-1"}
    return tuple(changed for id_, road in roads.items() for changed in _repair_road(id_, road, roads))


def _repair_road(id_: str, road: Element, roads: dict[str, Element]) -> Iterator[str]:
    for end, contact in CONTACTS.items():
        link = road.find(f"link/{end}")
        other_id = "" if link is None or link.get("elementType") != "road" else link.get("elementId", "")
        if link is None or other_id not in roads:
            continue
        answer = ENDS.get(link.get("contactPoint", ""), "predecessor")
        back = roads[other_id].find(f"link/{answer}")
        if back is not None and (back.get("elementType"), back.get("elementId")) == ("road", id_):
            continue
        _set_link(roads[other_id], answer, (id_, contact))
        _link_lanes_back(road, end, roads[other_id], answer)
        was = "nothing" if back is None else f"{back.get('elementType')} {back.get('elementId')}"
        yield f"road {other_id}: its {answer} is road {id_}, which says so, not {was}"


def _set_link(road: Element, end: str, to: tuple[str, str]) -> None:
    links = road.find("link")
    if links is None:
        links = ElementTree.SubElement(road, "link")
    for old in links.findall(end):
        links.remove(old)
    id_, contact = to
    ElementTree.SubElement(links, end, {"elementType": "road", "elementId": id_, "contactPoint": contact})


def _link_lanes_back(road: Element, end: str, other: Element, answer: str) -> None:
    """Link the lanes of `other` back to those of `road`, in the adjoining lane sections."""
    here, there = _list_lane_sections(road), _list_lane_sections(other)
    if not here or not there:
        return
    section, facing = here[0 if end == "predecessor" else -1], there[0 if answer == "predecessor" else -1]
    facing_lanes = {lane.get("id"): lane for lane in facing.iter("lane")}
    for lane in section.iter("lane"):
        link = lane.find(f"link/{end}")
        target = facing_lanes.get(link.get("id")) if link is not None else None
        if target is not None and target.find(f"link/{answer}") is None:
            links = target.find("link")
            if links is None:
                links = ElementTree.SubElement(target, "link")
            ElementTree.SubElement(links, answer, {"id": lane.get("id", "")})


def _list_lane_sections(road: Element) -> list[Element]:
    return list(road.iterfind("lanes/laneSection"))
