"""Networks that tests compile of SUMO's plain XML. No tests in here."""

import gzip
from pathlib import Path

from mdrive_sumo.roads import NetworkFile, RoadMap, load_road_map
from mdrive_sumo.roads.netconvert import run_netconvert
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, compute_net_checksum

TEE_NODES = """<nodes><node id="c" x="0" y="0" type="{kind}"/><node id="w" x="-80" y="0"/>
<node id="e" x="80" y="0"/><node id="s" x="0" y="-80"/></nodes>"""
TEE_EDGES = """<edges><edge id="w_in" from="w" to="c" priority="3"/><edge id="e_in" from="e" to="c" priority="3"/>
<edge id="s_in" from="s" to="c" priority="1"/><edge id="w_out" from="c" to="w" priority="3"/>
<edge id="e_out" from="c" to="e" priority="3"/><edge id="s_out" from="c" to="s" priority="1"/></edges>"""


def compile_tee(folder: Path, kind: str = "priority", *options: str) -> bytes:
    """Return the net of a T junction: a road from west to east, and one from the south. kind: SUMO's type of node."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "plain.nod.xml").write_text(TEE_NODES.format(kind=kind))
    (folder / "plain.edg.xml").write_text(TEE_EDGES)
    arguments = ("--node-files", "plain.nod.xml", "--edge-files", "plain.edg.xml", "--no-turnarounds", *options)
    return run_netconvert(arguments, folder, "tee: expected a network")


def save_network(folder: Path, net: bytes) -> RoadMap:
    """Write a network's folder of a net."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / NET_FILE).write_bytes(gzip.compress(net, mtime=0))
    about = NetworkFile(
        name=folder.name, origin="test", licence="none", offset=(0.0, 0.0), build=(), checksum=compute_net_checksum(net)
    )
    (folder / NETWORK_FILE).write_text(about.model_dump_json())
    return load_road_map(folder)
