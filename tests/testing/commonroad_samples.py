"""Small CommonRoad scenarios for tests."""

from collections.abc import Callable
from pathlib import Path


# --- small scenarios ---
def format_lanelet(id_: int, y: float, inside: str = "") -> str:
    left, right = (
        "".join(f"<point><x>{x}</x><y>{y + side}</y></point>" for x in (0, 50, 100)) for side in (1.75, -1.75)
    )
    return f"<lanelet id='{id_}'><leftBound>{left}</leftBound><rightBound>{right}</rightBound>{inside}</lanelet>"


def format_state(tag: str, time: int, x: float, yaw: str = "<exact>0.5</exact>") -> str:
    return (
        f"<{tag}><position><point><x>{x}</x><y>0</y></point></position><orientation>{yaw}</orientation>"
        f"<time><exact>{time}</exact></time><velocity><exact>5</exact></velocity></{tag}>"
    )


BOX = "<rectangle><length>4.5</length><width>1.8</width></rectangle>"


MOVES = (
    format_state("initialState", 3, 10)
    + "<trajectory>"
    + format_state("state", 4, 11)
    + format_state("state", 6, 13)
    + "</trajectory>"
)


def format_obstacle(
    id_: int, motion: str = MOVES, type_: str = "car", shape: str = BOX, tag: str = "dynamicObstacle"
) -> str:
    return f"<{tag} id='{id_}'><type>{type_}</type><shape>{shape}</shape>{motion}</{tag}>"


def format_parked(id_: int, type_: str = "parkedVehicle", shape: str = BOX) -> str:
    return format_obstacle(id_, format_state("initialState", 0, 30), type_, shape, "staticObstacle")


def format_scenario(*parts: str, version: str = "2020a", dt: str = "0.1", place: str = "USA_Test-1_1_T-1") -> str:
    location = "<location><geoNameId>1</geoNameId><gpsLatitude>0</gpsLatitude><gpsLongitude>0</gpsLongitude></location>"
    return (
        f"<commonRoad tags='' commonRoadVersion='{version}' timeStepSize='{dt}' benchmarkID='{place}' author='' "
        f"affiliation='' source='' date='2026-01-01'>{location}<scenarioTags/>{''.join(parts)}</commonRoad>"
    )


Write = Callable[..., Path]


SQUARE = "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in ((0, 0), (4, 0), (4, 2), (0, 2), (0, 0)))


def make_sign(id_: int, kind: str, value: str = "") -> str:
    more = f"<additionalValue>{value}</additionalValue>" if value else ""
    element = f"<trafficSignElement><trafficSignID>{kind}</trafficSignID>{more}</trafficSignElement>"
    return f"<trafficSign id='{id_}'>{element}<position><point><x>0</x><y>0</y></point></position></trafficSign>"


LANE, CAR = format_lanelet(1, 0), format_obstacle(7)
