"""The formats of `mdrive-sumo export`. A further one is one file with a writer and one row here."""

import importlib
import importlib.util
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.plug_ins import PlugIn, PlugInKind, check_plug_in_names, list_plug_ins

if TYPE_CHECKING:  # `export --help` lists the formats without loading NumPy and pydantic
    from mdrive_sumo.export.scored_recording import ScoredRecording

RecordingWriter = Callable[[Iterable["ScoredRecording"], Path], None]
"""Writes recordings into a folder that is empty and renamed when all is written."""


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format: its writer is imported when it is used, so that the base install has those that need no extra."""

    description: str
    writer: str
    """module:function of a `RecordingWriter`."""
    package: str = ""
    """Module of the package of the extra `export` that it needs; "" if it needs none."""
    is_in_log_frame: bool = True
    """Whether coordinates of a converted log are those of the log; else those of the network, whose file or picture
    goes with it. They differ only where the conversion shifted the log."""

    def load_writer(self) -> RecordingWriter:
        """Import the writer. Raises InputError with the command that installs the package if it is missing."""
        if self.package and importlib.util.find_spec(self.package) is None:
            raise InputError(
                f"export: expected the package of the module {self.package}, found none:"
                f" {format_installation('export')}"
            )
        module, _, function = self.writer.partition(":")
        return getattr(importlib.import_module(module), function)


EXPORT_FORMATS: Mapping[str, ExportFormat] = {
    "csv": ExportFormat("tables for spreadsheets and pandas", "mdrive_sumo.export.export_tables:write_csv"),
    "parquet": ExportFormat("the same tables, typed", "mdrive_sumo.export.parquet_tables:write_parquet", "pyarrow"),
    "fcd": ExportFormat(
        "floating car data of SUMO (XML)", "mdrive_sumo.export.sumo_fcd:write_fcd", is_in_log_frame=False
    ),
    "scenarionet": ExportFormat(
        "ScenarioNet data set for MetaDrive (pickles)", "mdrive_sumo.export.scenarionet_description:write_scenarionet"
    ),
    "commonroad": ExportFormat(
        "CommonRoad scenarios (XML 2020a)", "mdrive_sumo.export.commonroad_scenario:write_commonroad", "commonroad"
    ),
    "mcap": ExportFormat("3-D scenes for Foxglove", "mdrive_sumo.export.mcap_scenes:write_mcap", "foxglove", False),
    "openscenario": ExportFormat(
        "OpenSCENARIO XML 1.2 with OpenDRIVE maps",
        "mdrive_sumo.export.openscenario_storyboard:write_openscenario",
        "scenariogeneration",
        is_in_log_frame=False,
    ),
    "pcap": ExportFormat(
        "V2X messages as ETSI frames, for Wireshark",
        "mdrive_sumo.export.pcap_capture:write_pcap",
        "pycrate_asn1rt",
        is_in_log_frame=False,
    ),
}
"""Built-in format by name, as the command line lists them."""


def list_export_formats() -> Mapping[str, ExportFormat]:
    """Return all formats by name, those of other packages (`mdrive_sumo.export_formats`) last. Raises InputError."""
    check_plug_in_names(PlugInKind.EXPORT_FORMATS, EXPORT_FORMATS)
    plug_ins = list_plug_ins(PlugInKind.EXPORT_FORMATS)
    return {**EXPORT_FORMATS, **{name: _load_format(plug_in) for name, plug_in in plug_ins.items()}}


def _load_format(plug_in: PlugIn) -> ExportFormat:
    loaded = plug_in.load()
    if not isinstance(loaded, ExportFormat):
        raise InputError(f"{plug_in.describe()}: expected an ExportFormat, found {loaded!r:.80}")
    return loaded
