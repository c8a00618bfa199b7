"""The OpenAPI description with what FastAPI cannot derive: the problem schema and the published component names."""

import json
from collections.abc import Callable
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from server.api.problems import Problem

OPTIONAL_TOKEN = "OptionalToken"
"""Name of the scheme of operations that anyone may call and that tell the holder of a token more."""
_RENAMED = {"ChallengeTrack": "Track", "SubmissionState": "State", "TokenScope": "Scope"}


def make_openapi(app: FastAPI) -> Callable[[], dict[str, Any]]:
    """Return a function for `app.openapi` that builds the description on its first call."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            found = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
            problem = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
            found.setdefault("components", {}).setdefault("schemas", {})["Problem"] = problem
            app.openapi_schema = _use_published_names(_describe_tokens(found))
        return app.openapi_schema

    return openapi


def _describe_tokens(description: dict[str, Any]) -> dict[str, Any]:
    """Return the description with one scheme; where the token is optional, an empty requirement stands before it.

    OpenAPI 3.1, "Security Requirement Object": "To make security optional, an empty security requirement ({}) can be
    included in the array."
    """
    schemes: dict[str, Any] = description["components"]["securitySchemes"]
    schemes.pop(OPTIONAL_TOKEN)
    (required,) = ({name: []} for name in schemes)
    for methods in description["paths"].values():
        for operation in methods.values():
            if "security" in operation:
                is_required = required in operation["security"]
                operation["security"] = [required] if is_required else [{}, required]
    return description


def _use_published_names(description: dict[str, Any]) -> dict[str, Any]:
    """Return the description with the component names that clients know: without the suffixes `In` and `Out`."""
    components: dict[str, Any] = description["components"]["schemas"]
    published = {name: _RENAMED.get(name, name.removesuffix("Out").removesuffix("In")) for name in components}
    for name, schema in components.items():
        if schema.get("title") == name:
            schema["title"] = published[name]
    description["components"]["schemas"] = {published[name]: schema for name, schema in components.items()}
    text = json.dumps(description)
    for name, new in published.items():
        text = text.replace(f'"#/components/schemas/{name}"', f'"#/components/schemas/{new}"')
    return json.loads(text)
