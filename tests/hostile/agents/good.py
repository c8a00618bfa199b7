"""Answers every observation with the sum of its numbers."""

import socket

import numpy as np

with socket.socket(fileno=3) as evaluator:
    while data := evaluator.recv(65536):
        evaluator.sendall(np.frombuffer(data).sum().tobytes())
