"""Study mode: pages for participants and the organiser of a study with persons at the wheel."""
