"""Cut a text to a length."""


def truncate(text: str, max_length: int) -> str:
    """Return a text of at most `max_length` characters; three dots stand for what is cut off."""
    return text if len(text) <= max_length else text[: max_length - 3] + "..."
