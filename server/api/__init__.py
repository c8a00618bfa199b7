"""The HTTP API of the challenge, under /api/v1.

`app.create_app` makes it. Nothing is imported here: every child of `subprocess_runner` imports this package, and
without the application it starts in half the time.
"""
