"""`python -m mdrive_sumo`: the command line."""

from mdrive_sumo.cli import main

main(prog_name="python -m mdrive_sumo")
