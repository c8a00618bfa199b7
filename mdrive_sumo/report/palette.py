"""The colours of a scene, the same in the replay, in `show` and in pictures of episodes."""

import colorsys
from collections.abc import Mapping
from itertools import cycle
from types import MappingProxyType

from mdrive_sumo.core.state import Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scenario.scripted_actor import KindName

_FIXED = ("#2f6bed", "#e0701a", "#12946b", "#b83fa6", "#0f93b5", "#c93a4b", "#7a5be0", "#8a7a12")
_GOLDEN_ANGLE = 137.5 / 360
"""Share of a turn between neighbouring hues: no multiple of it comes near a whole number of turns soon."""
_COUNT = 32
"""Colours before they repeat; the scenarios of InterDrive have at most 8 CAVs."""
LIGHT: Mapping[str, str] = MappingProxyType(
    {
        "ground": "#f1f2ee",
        "road": "#c9ced6",
        "apron": "#dadde1",
        "line": "#fdfdfd",
        "footway": "#e1dccfcc",
        "building": "#ddd8cf",
        "building-edge": "#c4bdb0",
        "vehicle": "#5d6877",
        "vehicle-edge": "#eef1f5",
        "cyclist": "#9a5b12",
        "pedestrian": "#a2467f",
        "static": "#c99700",
        "ink": "#1b2129",
        "muted": "#5c6673",
        "halo": "#ffffff",
        "good": "#16855a",
        "warn": "#b96a00",
        "bad": "#cf2f3c",
        "grid": "#e3e6ea",
        "card": "#ffffff",
        "border": "#dfe2e6",
        "hover": "#eff2f6",
        "chosen": "#e6eefc",
        "focus": "#1f5fe0",
        "cam": "#6b7685",
        "cpm": "#0b8f8f",
        "mcm": "#7a4fd6",
        "text": "#b86a00",
    }
)
"""Custom properties of the replay in light mode, and the colours of pictures."""
KINDS: tuple[KindName, ...] = ("vehicle", "pedestrian", "cyclist", "static")
KIND_COLOURS: dict[KindName, str] = {kind: LIGHT[kind] for kind in KINDS}
"""Colour by kind, of scripted and background road users."""
MIN_SIZE_M = 0.9
"""Smaller actors are drawn at this size, because they would not be visible otherwise."""
DARK: Mapping[str, str] = MappingProxyType(
    {
        "ground": "#14171b",
        "road": "#2b3038",
        "apron": "#22262c",
        "line": "#6d7683",
        "footway": "#3e4348a6",
        "building": "#22272d",
        "building-edge": "#3d444d",
        "vehicle": "#9aa5b4",
        "vehicle-edge": "#1a1e24",
        "cyclist": "#d69a4e",
        "pedestrian": "#d986bb",
        "static": "#e0b040",
        "ink": "#e8ebef",
        "muted": "#98a2af",
        "halo": "#f4f6f8",
        "good": "#3dbb86",
        "warn": "#e3a13c",
        "bad": "#ef5964",
        "grid": "#2c323a",
        "card": "#1b1f25",
        "border": "#30363e",
        "hover": "#262b33",
        "chosen": "#22304a",
        "focus": "#79a6ff",
        "cam": "#9aa6b5",
        "cpm": "#36c2bd",
        "mcm": "#ab8bff",
        "text": "#f0ad4a",
    }
)


def _make_colour(number: int) -> str:
    """Return a colour whose hue is the golden angle away from that before: neighbours in a list differ."""
    parts = colorsys.hls_to_rgb(number * _GOLDEN_ANGLE % 1.0, 0.46, 0.62)
    return "#" + "".join(f"{round(255 * part):02x}" for part in parts)


CAV_COLOURS = (*_FIXED, *(_make_colour(number) for number in range(len(_FIXED), _COUNT)))
"""Colours of the CAVs in the order of the scenario; they repeat after the last."""


def format_custom_properties() -> str:
    """Return the colours as a style sheet: custom properties of the root, light and dark."""
    light, dark = (" ".join(f"--{name}: {value};" for name, value in colours.items()) for colours in (LIGHT, DARK))
    return f":root {{ {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"


def choose_colours(record: EpisodeRecord) -> list[str]:
    """Return the colour of every road user by column: CAVs by their order, others by their kind."""
    by_kind = {Kind[name.upper()]: colour for name, colour in KIND_COLOURS.items()}
    cavs = [colour for _, colour in zip(range(record.egos), cycle(CAV_COLOURS), strict=False)]
    return [*cavs, *(by_kind[Kind(kind)] for kind in record.kind[record.egos :].tolist())]
