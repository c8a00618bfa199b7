"""`mdrive-sumo list metrics` and `list plug-ins`."""

from mdrive_sumo.core.plug_ins import PREFIX, SHORT_CHECKSUM, PlugIn, PlugInKind, list_plug_ins
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.scoring.metrics import METRICS, InfractionMetric
from mdrive_sumo.scoring.metrics.registry import load_metric_plug_ins


def list_metrics(_: str) -> str:
    """Return the table of all metrics, those of other packages last. Raises InputError."""
    rows = [
        (metric.name, "changes DS" if isinstance(metric, InfractionMetric) else "informative", origin)
        for metrics, origin in ((METRICS, "built in"), (load_metric_plug_ins(), "plug-in"))
        for metric in metrics
    ]
    return format_text(make_text_table(("metric", "kind", "from"), rows))


def list_plug_in_table(_: str) -> str:
    """Return the table of the plug-ins of other packages, with what identifies them."""
    rows = [
        (
            str(kind),
            name,
            one.package,
            one.version,
            _shorten_checksum(one),
            one.locator,
        )
        for kind in PlugInKind
        for name, one in list_plug_ins(kind).items()
    ]
    if not rows:
        groups = ", ".join(f"{PREFIX}{kind}" for kind in PlugInKind)
        return f"no plug-ins are installed; their entry points are in the groups {groups}"
    return format_text(make_text_table(("kind", "name", "package", "version", "checksum", "object"), rows))


def _shorten_checksum(plug_in: PlugIn) -> str:
    return plug_in.identify().rpartition("sha256:")[2][:SHORT_CHECKSUM]
