"""Benchmarks: `run/bench` and `run/bench-peers`."""
