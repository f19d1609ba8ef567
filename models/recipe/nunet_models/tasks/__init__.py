"""What components before the last one may predict besides labels and depth."""
