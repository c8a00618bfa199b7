"""A town of one straight road, and route files of CARLA on it."""

from collections.abc import Sequence
from pathlib import Path

_LANE = '<lane id="{}" type="driving"><link/><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
ROAD = f"""<OpenDRIVE><header revMajor="1" revMinor="4"/><road id="7" junction="-1" length="200">
<planView><geometry s="0" x="0" y="0" hdg="0" length="200"><line/></geometry></planView>
<lanes><laneSection s="0"><left>{_LANE.format(1)}</left><center><lane id="0" type="none" level="false"/></center>
<right>{_LANE.format(-1)}{_LANE.format(-2)}</right></laneSection></lanes></road></OpenDRIVE>"""
"""200 m eastwards in CARLA too; centres of the eastbound lanes at CARLA y = 1.75 and 5.25, westbound -1.75."""

Points = Sequence[tuple[float, float]]


def make_town(folder: Path) -> Path:
    """Writes TownXX.xodr into a new folder."""
    folder.mkdir()
    (folder / "TownXX.xodr").write_text(ROAD)
    return folder


def route_xml(points: Points, town: str = "TownXX") -> str:
    """A route file."""
    tags = "".join(f'<waypoint x="{x}" y="{y}" z="0" yaw="0"/>' for x, y in points)
    return f'<routes><route id="1" town="{town}">{tags}</route></routes>'
