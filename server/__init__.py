"""The challenge server: takes agents in over HTTP, drives them in boxes of their own, ranks them."""

COMMANDS = {
    "admin": "Look after a challenge: teams, tokens, phases, backups.",
    "check": "Check an agent before it is submitted.",
    "init-agent": "Write a sample agent to begin with.",
    "serve": "Serve a challenge: API, pages and workers.",
    "submit": "Submit an agent to a challenge, or try it here.",
}
"""One line of help for each command that this package adds to `mdrive-sumo`."""
