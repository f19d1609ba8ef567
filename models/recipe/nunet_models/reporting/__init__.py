"""Tables and figures from runs and evaluations."""
