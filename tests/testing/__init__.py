"""What several tests share: fakes, sample data, worlds to drive in. No tests in here."""
