"""The OpenAPI description, completed by what FastAPI cannot know."""

from collections.abc import Callable
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from server.api.problems import Problem


def described(app: FastAPI) -> Callable[[], dict[str, Any]]:
    """For `app.openapi`: made when first asked for."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            found = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
            problem = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
            found.setdefault("components", {}).setdefault("schemas", {})["Problem"] = problem
            app.openapi_schema = found
        return app.openapi_schema

    return openapi
