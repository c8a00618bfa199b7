"""Tables as pandas data frames. pandas is optional and imported on first use."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation

if TYPE_CHECKING:
    from types import ModuleType

    import pandas as pd


def build_data_frame(
    data: Mapping[str, Any] | Iterable[Mapping[str, Any]], columns: Sequence[str] | None = None
) -> "pd.DataFrame":
    """Return a data frame of columns by name, or of rows as mappings.

    Raises InputError with the command that installs pandas if it is missing.
    """
    pandas = _import_pandas()
    return pandas.DataFrame(data if isinstance(data, Mapping) else list(data), columns=columns)


def _import_pandas() -> "ModuleType":
    try:
        import pandas
    except ModuleNotFoundError:
        raise InputError(
            f"to_frame: expected the package pandas, found none; run `{format_installation('notebook')}`"
        ) from None
    return pandas
