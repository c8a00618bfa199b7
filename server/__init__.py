"""The challenge server: accepts agents over HTTP, runs them in sandboxes, and ranks their results."""

COMMANDS = {
    "admin": "Administer a challenge: teams, tokens, phases, backups.",
    "cancel": "Cancel a submission.",
    "check": "Check an agent before submission.",
    "drive": "Drive CAVs of a scenario yourself, in the browser.",
    "init-agent": "Write a sample agent as a starting point.",
    "results": "Show the result of a submission, or list yours.",
    "serve": "Serve a challenge: API, web pages and workers.",
    "study human": "Study persons at the wheel: plan, pages, questionnaires, results (RQ4).",
    "submit": "Submit an agent to a challenge, or test it locally.",
}
"""Help line of each command that this package adds to `mdrive-sumo`."""
