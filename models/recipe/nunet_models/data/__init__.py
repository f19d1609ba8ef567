"""Pairs of pictures and truth: reading, caching, augmenting, batching."""
