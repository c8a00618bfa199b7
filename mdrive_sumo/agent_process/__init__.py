"""Agents outside the worker process: wire protocol, child process, sandbox, adapter for CARLA leaderboard agents."""
