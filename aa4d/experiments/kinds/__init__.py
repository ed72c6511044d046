"""Kinds of tasks that experiments are made of (aa4d/graph/kinds.py)."""
