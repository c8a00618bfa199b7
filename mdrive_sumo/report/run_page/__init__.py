"""Pages of whole runs: one run with what each CAV lost, several runs compared, two replays in step."""
