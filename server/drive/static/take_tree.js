// The tree of takes.
