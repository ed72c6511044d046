"""Damaged and hostile files for every reader: `make fuzz`, and a few hundred of them in the ordinary tests."""
