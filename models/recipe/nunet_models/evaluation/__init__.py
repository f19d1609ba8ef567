"""Accuracy: protocols of evaluation, and the verb that carries them out."""
