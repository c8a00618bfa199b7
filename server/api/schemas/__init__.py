"""Request and response bodies of the API, by subject. Times are ISO 8601 in UTC.

The OpenAPI description uses the class names without the suffixes `In` and `Out`.
"""
