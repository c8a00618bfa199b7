"""Small OpenDRIVE maps, one for every kind of peculiarity that public files have."""

from collections.abc import Mapping, Sequence

HEADER = '<header revMajor="1" revMinor="6" name="own" version="1.0" north="0" south="0" east="0" west="0"/>'
TOWN = '<type s="0" type="town"><speed max="50" unit="km/h"/></type>'
CENTRE = '<center><lane id="0" type="none" level="false"/></center>'
LINE = "<line/>"
SPIRAL = '<spiral curvStart="0" curvEnd="0.02"/>'
NORMALIZED = '<paramPoly3 pRange="normalized" aU="0" bU="99" cU="0" dU="0" aV="0" bV="0" cV="10" dV="0"/>'  # 100 m long
STOP = '<signal id="9" s="50" t="-5" type="206" orientation="+" dynamic="no"/>'


def format_width(a: float = 3.5, b: float = 0, c: float = 0, d: float = 0, s: float = 0) -> str:
    return f'<width sOffset="{s}" a="{a}" b="{b}" c="{c}" d="{d}"/>'


def format_lane(id_: int, inside: str = "", type_: str = "driving", more: str = "") -> str:
    """Format a lane 3.5 m wide; `inside` takes the place of its width, links before it included."""
    return f'<lane id="{id_}" type="{type_}" level="false" {more}>{inside or format_width()}</lane>'


def format_links(before: int | None = None, after: int | None = None) -> str:
    links = {"predecessor": before, "successor": after}
    return "<link>" + "".join(f'<{tag} id="{id_}"/>' for tag, id_ in links.items() if id_ is not None) + "</link>"


def format_section(left: Sequence[str] = (), right: Sequence[str] = (), s: float = 0) -> str:
    sides = (f"<left>{''.join(left)}</left>" if left else "", f"<right>{''.join(right)}</right>" if right else "")
    return f'<laneSection s="{s}">{sides[0]}{CENTRE}{sides[1]}</laneSection>'


TWO_WAY = format_section([format_lane(1)], [format_lane(-1)])


def format_geometry(
    shape: str = LINE, length: float = 100, s: float = 0, x: float = 0, y: float = 0, hdg: float = 0
) -> str:
    return f'<geometry s="{s}" x="{x}" y="{y}" hdg="{hdg}" length="{length}">{shape}</geometry>'


def format_road(id_: str = "1", geometry: str = "", sections: str = TWO_WAY, length: float = 100, **parts: str) -> str:
    """Format a road; `parts`: link, type, junction, offset, profile, signals, more (attributes)."""
    junction = parts.get("junction", 'junction="-1"')
    return (
        f'<road name="" length="{length}" id="{id_}" {junction} {parts.get("more", "")}>{parts.get("link", "")}'
        f"{parts.get('type', TOWN)}<planView>{geometry or format_geometry(length=length)}</planView>"
        f"{parts.get('profile', '')}<lanes>{parts.get('offset', '')}{sections}</lanes>"
        f"<signals>{parts.get('signals', '')}</signals></road>"
    )


def format_map(*roads: str, root: str = "<OpenDRIVE>", header: str = HEADER, junctions: str = "") -> str:
    return f'<?xml version="1.0" encoding="UTF-8"?>{root}{header}{"".join(roads)}{junctions}</OpenDRIVE>'


def format_end(tag: str, kind: str, id_: str, contact: str = "") -> str:
    where = f' contactPoint="{contact}"' if contact else ""
    return f'<{tag} elementType="{kind}" elementId="{id_}"{where}/>'


def _format_shape(shape: str, **parts: str) -> str:
    return format_map(format_road(geometry=format_geometry(shape), **parts))


def _format_reference(text: str) -> str:
    reference = f"<geoReference><![CDATA[{text}]]></geoReference></header>"
    return format_map(format_road(), header=HEADER.replace("/>", f">{reference}"))


def format_crossing(
    kind: str = "", connection: str = 'connectingRoad="3" contactPoint="start"', lanes: str = ""
) -> str:
    """Format a road before a junction, one behind it, and the road between them."""
    before = format_road("1", length=50, link=f"<link>{format_end('successor', 'junction', '7')}</link>")
    behind = format_road(
        "2",
        format_geometry(x=70, length=50),
        length=50,
        link=f"<link>{format_end('predecessor', 'junction', '7')}</link>",
    )
    within = format_road(
        "3",
        format_geometry(x=50, length=20),
        format_section([], [format_lane(-1, format_links(-1, -1) + format_width())]),
        length=20,
        junction='junction="7"',
        link="<link>"
        + format_end("predecessor", "road", "1", "end")
        + format_end("successor", "road", "2", "start")
        + "</link>",
    )
    links = lanes or '<laneLink from="-1" to="-1"/>'
    junction = f'<junction id="7" name="" {kind}><connection id="0" incomingRoad="1" {connection}>{links}</connection>'
    return format_map(before, within, behind, junctions=f"{junction}</junction>")


def format_direct_junction(shift: float = 0.0) -> str:
    """Format a road of two lanes that splits into two roads of one lane without a road between them."""
    first = format_road(
        "1",
        sections=format_section([], [format_lane(-1), format_lane(-2)]),
        link=f"<link>{format_end('successor', 'junction', '7')}</link>",
    )
    ends = (
        format_road(
            id_,
            format_geometry(x=100, y=y, hdg=hdg),
            format_section([], [format_lane(-1)]),
            link=f"<link>{format_end('predecessor', 'junction', '7')}</link>",
        )
        for id_, y, hdg in (("2", 0.0, 0.0), ("3", -3.5 - shift, -0.1))
    )
    connections = "".join(
        f'<connection id="{k}" incomingRoad="1" linkedRoad="{road}" contactPoint="start">'
        f'<laneLink from="{lane}" to="-1"/></connection>'
        for k, (road, lane) in enumerate((("2", -1), ("3", -2)))
    )
    return format_map(first, *ends, junctions=f'<junction id="7" name="" type="direct">{connections}</junction>')


VIRTUAL = (
    '<junction id="7" name="" type="virtual" mainRoad="1" sStart="40" sEnd="60" orientation="+">'
    '<connection id="0" type="virtual"><predecessor elementType="road" elementId="1" elementS="50" elementDir="+"/>'
    '<successor elementType="road" elementId="2" contactPoint="start"/></connection></junction>'
)
MEDIAN = format_section(
    [format_lane(1)], [format_lane(-1, format_width(2), "median"), format_lane(-2), format_lane(-3)]
)
ZERO = format_width(0)
SECTIONS = (
    format_section([], [format_lane(-1, format_links(after=-1) + format_width())])
    + format_section(
        [], [format_lane(-1, format_links(-1, -1) + format_width()), format_lane(-2, format_width(0, 0.05))], 40
    )
    + format_section([], [format_lane(-1, format_links(-1) + format_width()), format_lane(-2)], 80)
)

CONVERTIBLE: Mapping[str, str] = {
    "plain": format_map(format_road()),
    "namespace": format_map(format_road(), root='<OpenDRIVE xmlns="http://www.opendrive.org">'),
    "schema location": format_map(
        format_road(),
        root='<OpenDRIVE xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="x.xsd">',
    ),
    "namespace and one-sided link": format_map(
        format_road("1", length=60, link=f"<link>{format_end('successor', 'road', '2', 'start')}</link>"),
        format_road("2", format_geometry(x=60, length=40), length=40),
        root='<OpenDRIVE xmlns="http://www.opendrive.org">',
    ),
    "byte order mark": "\ufeff" + format_map(format_road()),
    "no header": format_map(format_road(), header=""),
    "version 1.1": format_map(format_road(), header=HEADER.replace('revMinor="6"', 'revMinor="1"')),
    "version 1.8": format_map(format_road(), header=HEADER.replace('revMinor="6"', 'revMinor="8"')),
    "left-hand": format_map(format_road(more='rule="LHT"')),
    "lanes without width at the reference line": format_map(
        format_road(
            sections=format_section([format_lane(1, ZERO), format_lane(2)], [format_lane(-1, ZERO), format_lane(-2)])
        )
    ),
    "a lane that grows at the reference line": format_map(
        format_road(sections=format_section([], [format_lane(-1, format_width(0, 0.035)), format_lane(-2)]))
    ),
    "a median between the lanes": format_map(format_road(sections=MEDIAN)),
    "several widths of a lane": format_map(
        format_road(sections=format_section([], [format_lane(-1, format_width(3) + format_width(s=40))]))
    ),
    "borders for widths": format_map(
        format_road(sections=format_section([], [format_lane(-1, '<border sOffset="0" a="-3.5" b="0" c="0" d="0"/>')]))
    ),
    "several sections": format_map(format_road(sections=SECTIONS)),
    "a lane offset": format_map(format_road(offset='<laneOffset s="0" a="1.75" b="0" c="0" d="0"/>')),
    "a stop sign on a spiral": _format_shape(SPIRAL, signals=STOP),
    "a stop sign on a cubic": _format_shape('<poly3 a="0" b="0" c="0.001" d="0"/>', signals=STOP),
    "a stop sign on a parametric cubic": _format_shape(NORMALIZED, signals=STOP),
    "a stop sign without its place": format_map(format_road(signals='<signal id="9" s="50" type="206"/>')),
    "a stop sign behind the end": format_map(format_road(signals=STOP.replace('s="50"', 's="150"'))),
    "a stop sign before the start": format_map(format_road(signals=STOP.replace('s="50"', 's="-1"'))),
    "a signal without orientation": format_map(format_road(signals='<signal id="9" s="5" t="-5" type="206"/>')),
    "a reference to a lost signal": format_map(
        format_road(signals='<signalReference id="404" s="5" t="0" orientation="+"/>')
    ),
    "geometry that begins late": format_map(format_road(geometry=format_geometry(s=0.001), signals=STOP)),
    "geometry without length": format_map(
        format_road(geometry=format_geometry(length=0) + format_geometry(), signals=STOP)
    ),
    "an arc without curvature": _format_shape('<arc curvature="0"/>'),
    "a spiral of one curvature": _format_shape('<spiral curvStart="0.01" curvEnd="0.01"/>'),
    "a spiral without curvature": _format_shape('<spiral curvStart="0" curvEnd="0"/>'),
    "a short road": format_map(format_road(), format_road("2", format_geometry(x=100, length=0.01), length=0.01)),
    "a road without length": format_map(format_road(), format_road("2", format_geometry(x=100, length=0), length=0)),
    "elevation": format_map(
        format_road(
            profile='<elevationProfile><elevation s="0" a="10" b="0.02" c="0" d="0"/></elevationProfile>'
            '<lateralProfile><superelevation s="0" a="0.05" b="0" c="0" d="0"/></lateralProfile>'
        )
    ),
    "limits in miles": format_map(format_road(type='<type s="0" type="town"><speed max="35" unit="mph"/></type>')),
    "no limit": format_map(format_road(type='<type s="0" type="motorway"><speed max="no limit"/></type>')),
    "no limit of a lane": format_map(
        format_road(
            sections=format_section([], [format_lane(-1, format_width() + '<speed sOffset="0" max="no limit"/>')])
        )
    ),
    "no type": format_map(format_road(type="")),
    "no projection": _format_reference(""),
    "a projection by code": _format_reference("EPSG:25832"),
    "a projection with a geoid": _format_reference("+proj=tmerc +lat_0=37 +lon_0=-122 +geoidgrids=egm96_15.gtx"),
    "coordinates of a projection": format_map(format_road(geometry=format_geometry(x=683000, y=5400000))),
    "an offset of the header": format_map(
        format_road(), header=HEADER.replace("/>", '><offset x="683000" y="5400000" z="0" hdg="0"/></header>')
    ),
    "no junction of a road": format_map(format_road(junction="")),
    "ids with spaces": format_map(format_road("road a")),
    "ids with a colon": format_map(format_road(":1")),
    "ids with slashes": format_map(format_road("a/b|c;d")),
    "junction": format_crossing(),
    "direct junction": format_direct_junction(),
    "virtual junction": format_map(
        format_road(),
        format_road("2", format_geometry(x=50, y=-3.5, hdg=-0.8, length=30), length=30, junction='junction="7"'),
        junctions=VIRTUAL,
    ),
    "a junction with a lost road": format_crossing(connection='connectingRoad="99" contactPoint="start"'),
    "a link to a lost road": format_map(
        format_road(link=f"<link>{format_end('successor', 'road', '99', 'start')}</link>")
    ),
    "a link to a lost junction": format_map(
        format_road(link=f"<link>{format_end('successor', 'junction', '99')}</link>")
    ),
    "a road without driving lanes": format_map(
        format_road(), format_road("2", format_geometry(y=50), format_section([], [format_lane(-1, type_="sidewalk")]))
    ),
    "a road without lanes": format_map(format_road(), format_road("2", format_geometry(y=50), format_section())),
}
"""Kind of map -> text of a map that becomes a network."""

REFUSED: Mapping[str, tuple[str, str]] = {
    "no driving lane": (
        format_map(format_road(sections=format_section([], [format_lane(-1, type_="sidewalk")]))),
        "expected a map that netconvert accepts, found: No edges loaded",
    ),
    "both rules": (
        format_map(format_road(more='rule="LHT"'), format_road("2", format_geometry(y=50), more='rule="RHT"')),
        "expected roads of one rule, found LHT and RHT",
    ),
    "an unknown rule": (format_map(format_road(more='rule="UHT"')), "road 1: rule: expected RHT or LHT, found 'UHT'"),
    "one id twice": (
        format_map(format_road(), format_road(geometry=format_geometry(y=50))),
        "expected roads of different ids, found 1 twice",
    ),
    "no heading": (
        format_map(format_road(geometry=format_geometry().replace('hdg="0"', ""))),
        "geometry: hdg: expected a finite number, found None",
    ),
    "no shape": (
        _format_shape(""),
        "road 1: expected a line, arc, spiral, poly3 or paramPoly3 in every geometry, found none",
    ),
    "an unknown shape": (
        _format_shape("<nurbs/>"),
        "road 1: expected a line, arc, spiral, poly3 or paramPoly3 in every geometry, found nurbs",
    ),
}
"""Kind of map -> text of a map that is refused, and words of the sentence that says why."""
