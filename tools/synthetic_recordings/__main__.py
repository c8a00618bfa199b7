"""`python -m tools.synthetic_recordings`: see make.py."""

from tools.synthetic_recordings.make import main

if __name__ == "__main__":
    main()
