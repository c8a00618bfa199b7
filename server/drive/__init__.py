"""A person at the wheel: pages, WebSocket and simulation processes of `mdrive-sumo drive`."""
