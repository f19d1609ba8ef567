"""From a network to model files."""
