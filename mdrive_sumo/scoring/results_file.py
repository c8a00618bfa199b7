"""Load, save and describe `results.json`."""

import json
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.scenario import describe_first_error, shorten_value
from mdrive_sumo.scoring.results import FORMAT, Results


def load_results(path: Path) -> Results:
    """Load a results file. Raises InputError for one that is missing, corrupt or of another version."""
    try:
        data: Any = json.loads(path.read_bytes())
        if isinstance(data, dict) and data.get("format") != FORMAT:
            raise InputError(f"{path}: format: expected {FORMAT!r}, found {shorten_value(data.get('format'))}")
        return Results.model_validate(data)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON, found a corrupt file ({error})") from None


def save_results(results: Results, path: Path) -> None:
    """Write the file atomically (a temporary file is renamed); equal results give equal bytes."""
    temporary = path.with_suffix(".tmp")
    temporary.write_text(results.model_dump_json(indent=1) + "\n", encoding="utf-8")
    temporary.replace(path)


def build_results_schema() -> dict[str, Any]:
    """Return the JSON Schema of `results.json` (`mdrive-sumo schema results`)."""
    return Results.model_json_schema(mode="serialization")
