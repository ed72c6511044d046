"""Graphs of tasks: each is run once, by any engine, and its result is kept under the identity of all that made it."""
