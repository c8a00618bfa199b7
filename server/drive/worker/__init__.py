"""The processes that simulate a drive: `python -m server.drive.worker`, started by `SimulationProcess`.

A supervisor, which runs no simulation itself, forks one process per running take. Those fork checkpoints, which wait
until a take branches from them. All of them end when the connection to the server is closed.
"""
