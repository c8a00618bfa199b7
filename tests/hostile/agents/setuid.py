"""Runs the set-uid program in `/tools`, made for this: its user must stay the box's."""

import subprocess

from tell import tell

tell(user=subprocess.run(["/tools/id", "-u"], capture_output=True, text=True, check=False).stdout.strip())
