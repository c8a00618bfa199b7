"""`python -m tools.synthetic_recordings`: see build_suite.py."""

from tools.synthetic_recordings.build_suite import main

if __name__ == "__main__":
    main()
