"""Accuracy: protocols of evaluation, and the subcommand that carries them out."""
