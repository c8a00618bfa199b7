"""What of a message arrives over a radio: path loss, shadowing, packet errors, load and collisions. docs/radio.md."""
