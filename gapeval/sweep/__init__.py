"""A grid of configurations over all frames of all logs."""
