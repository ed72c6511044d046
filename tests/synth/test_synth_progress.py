"""Progress lines."""

import io

from synth.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_terminal_gets_one_line_that_updates() -> None:
    stream = Terminal()
    progress = Progress("frame", 3, stream)
    for _ in range(3):
        progress.advance(0.15)
        progress.advance(0.85)
    written = stream.getvalue()
    assert written.count("\n") == 1
    assert written.count("\r") == 6
    assert "frame 1/3" in written
    assert "left" in written
    assert written.endswith("in all\n")


def test_log_gets_few_lines() -> None:
    stream = io.StringIO()
    progress = Progress("frame", 500, stream)
    for _ in range(500):
        progress.advance()
    assert stream.getvalue().splitlines() == [stream.getvalue().strip()]
    assert stream.getvalue().startswith("frame 500/500")
