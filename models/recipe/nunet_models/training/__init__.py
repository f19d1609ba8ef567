"""Training: one component at a time, resumable to the same losses."""
