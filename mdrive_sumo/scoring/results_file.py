"""Load, save and describe `results.json`."""

import json
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import PydanticSerializationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.scenario.scenario import describe_first_error, shorten_value
from mdrive_sumo.scoring.results import FORMAT, Results
from mdrive_sumo.scoring.results_check import find_result_faults


def load_results(path: Path) -> Results:
    """Load a results file.

    Raises InputError for one that is missing, corrupt, of another version, or contains what cannot be: a value out of
    its range, a scenario twice, a mean that does not fit.
    """
    results = load_unchecked_results(path)
    faults = list(find_result_faults(results))
    if faults:
        more = f" (and {len(faults) - 1} more that cannot be)" if len(faults) > 1 else ""
        raise InputError(f"{path}: {faults[0]}{more}")
    return results


def load_unchecked_results(path: Path) -> Results:
    """As `load_results`, of any content that has the right form: for `verify`, which compares every number.

    Raises InputError for a file that is missing, corrupt or of another version.
    """
    try:
        data: Any = json.loads(read_bytes(path))
        if isinstance(data, dict) and (stated := data.get("format")) != FORMAT:  # else the first missing field is named
            raise InputError(f"{path}: format: expected {FORMAT!r}, found {shorten_value(stated)}")
        return Results.model_validate(data)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON, found a corrupt file ({error})") from None


def save_results(results: Results, path: Path) -> None:
    """Write the file atomically (a new file is renamed); equal results give equal bytes.

    Raises InputError for text that UTF-8 lacks: lone surrogates, as a changed file may hold.
    """
    try:
        text = results.model_dump_json(indent=1)
    except PydanticSerializationError:
        raise InputError(f"{path}: expected text, found a lone surrogate, which no file can hold") from None
    write_text(path, text + "\n")


def build_results_schema() -> dict[str, Any]:
    """Return the JSON Schema of `results.json` (`mdrive-sumo schema results`)."""
    return Results.model_json_schema(mode="serialization")
