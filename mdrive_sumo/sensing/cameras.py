"""TEMPORARY stand-in."""


def camera_error(kind: str) -> str:
    return ""
