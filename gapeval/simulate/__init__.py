"""Simulated logs with exact labels: scenes, robots with sensors, ray casting."""
