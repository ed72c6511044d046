"""Benchmarks that need more than aa4d itself; run by hand, never by pytest."""
