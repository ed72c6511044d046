"""The program `aa4d`, and `python -m aa4d`."""

from __future__ import annotations

from aa4d.interrupts import end_quietly_while_importing


def main() -> None:
    end_quietly_while_importing()
    # Imported behind it, for that takes a moment.
    from aa4d.cli import main as command_line

    command_line()


if __name__ == "__main__":
    main()
