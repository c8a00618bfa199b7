"""The script of the 3-D view: three.js and the files of `report/static/view_3d*.js` as one classic script."""

from functools import lru_cache

from mdrive_sumo.report.html_page import read_static

THREE = "three.min.js"
"""Bundle of the parts that the view uses; `tools/bundle_three.py` makes it."""
SCRIPTS = (
    "view_3d_shaders.js",
    "view_3d_scene.js",
    "view_3d_users.js",
    "view_3d_effects.js",
    "view_3d_overlays.js",
    "view_3d_cameras.js",
    "view_3d.js",
)
GLOBALS = ("View3D", "decodeScene")
"""What the script defines."""


@lru_cache(maxsize=1)
def build_view_3d_script() -> str:
    """Return the script, which defines `View3D` and `decodeScene` and nothing else."""
    parts = (read_static(THREE), *map(read_static, SCRIPTS), f"Object.assign(globalThis, {{ {', '.join(GLOBALS)} }});")
    return "(() => {\n" + "\n".join(parts) + "\n})();\n"
