"""Settings: frozen dataclasses that a TOML file and `--set` can change, every value checked where it is declared."""
