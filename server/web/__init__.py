"""The web pages of the challenge; programs use the API."""
