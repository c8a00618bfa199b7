"""`python -m tools.synthetic_recordings`: see make.py."""

from tools.synthetic_recordings.build_suite import main

if __name__ == "__main__":
    main()
