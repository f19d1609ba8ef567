"""From a network to model files that say what they are."""
