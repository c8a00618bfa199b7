"""`mdrive-sumo learn`: training data, training, evaluation and export of learned systems."""

import click

from mdrive_sumo.cli.learn_data import command as data_command

command = click.Group("learn", help="Train systems that see through cameras: data, training, evaluation, export.")
command.add_command(data_command)
