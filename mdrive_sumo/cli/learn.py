"""`mdrive-sumo learn`: training data, training, evaluation and export of learned systems."""

import click

from mdrive_sumo.cli.learn_data import command as data_command
from mdrive_sumo.cli.learn_evaluate import command as evaluate_command
from mdrive_sumo.cli.learn_export import command as export_command
from mdrive_sumo.cli.learn_train import command as train_command

command = click.Group("learn", help="Train systems that see through cameras: data, training, evaluation, export.")
command.add_command(data_command)
command.add_command(train_command)
command.add_command(evaluate_command)
command.add_command(export_command)
