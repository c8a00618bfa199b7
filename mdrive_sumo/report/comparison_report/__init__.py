"""Reports over several runs: tables, figures and pages that rank agents, with an interval on every difference."""
