"""The negotiator with a language model of its own: vocabulary, grammar of answers, and its decoder."""
