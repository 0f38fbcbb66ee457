"""The result files: their columns, how they are written, and what they were made from."""
