"""Several networks trained, measured and compared by one plan."""
