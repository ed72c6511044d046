"""Panels of the cost report, a module and an entry (aa4d/cost/__init__.py) each."""
