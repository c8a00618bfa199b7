"""`python -m real2sim.synthetic`: see make.py."""

from real2sim.synthetic.make import main

if __name__ == "__main__":
    main()
