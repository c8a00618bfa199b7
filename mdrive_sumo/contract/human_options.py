"""Names of the agents of people and of their options: known without the agents, which import planning."""

HUMAN, HUMAN_REPLAY = "human", "human-replay"
"""A person at the wheel, and the agent that repeats what a person did."""
SUBSTITUTES_OPTION = "substitutes"
"""Option of both: built-in agents that may drive in between, with commas between them."""
TAKE_OPTION = "take"
"""Option of `HUMAN_REPLAY`: the run folder of the take."""
DEVICES = ("unknown", "keyboard", "gamepad", "wheel", "touch", "script")
"""Input devices, of the option `device` and of the notes of drivers."""
