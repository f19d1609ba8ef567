"""Pairs of images and truth: reading, caching, augmenting, batching."""
