"""What a sweep's folder says: its rows, the recommended configuration, figures, frames, times."""
