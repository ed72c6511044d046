"""The table of hard cases, for the console and as a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from aa4d.stress.runner import Outcome

HEAD = """# Hard cases

Inputs on which software of this kind loses digits, divides by zero, hangs or draws something wrong without a word, and
what this one does with them. Each row is a check that runs: its error is against a float64 reference or a closed form,
or it is 0 for a refusal in one sentence. The cases are in `tests/hard_cases/`, one file a part; `make test` runs them.

`aa4d stress --write docs/hard-cases.md` wrote this page. `--part NAME` runs one part, `--budget SECONDS` then searches
for inputs that break a bound and shrinks what it finds (`pip install -e ".[dev]"` brings hypothesis, which it needs).
`make sanitize` runs the native code's cases under AddressSanitizer and UndefinedBehaviorSanitizer, `make
sanitize-threads` its thread pool and its kernels under ThreadSanitizer, and `make fuzz` gives every reader thousands of
damaged files. `make faults` runs every command that writes on a disk that is full at each of its writes and in folders
that it may not write, and kills it at random moments.
"""

MEASURED = """
## A long run

30,000 iterations on a capture that code makes to be hostile: poles and wires thinner than a pixel, sky, a white and a
black frame, an exposure that jumps by 2.5, every initial point three times, and a camera that comes within 0.1 m of a
wall while a car passes. A run that meets NaN or infinity ends with what and where; below are loss and the largest
magnitudes of some parameter groups, in the picture those of all.

![Loss and largest magnitudes over the iterations](images/long-run.png)

<!-- measured: long-run -->
<!-- end -->

## Full disks, folders that may not be written, and `kill -9`

Each command on small inputs. Each kind of file that it writes, by whatever library, is cut short once at its last page
on a file system that is full there (files that a number or a random part of their names tells apart are one kind, of
which the first is cut). And the command runs where too few files can be made, on a file system that is read-only, and
in folders without permission: it has to say so in one sentence with exit code 2, leave nothing half-written and what
was there as it was, and come to the same result once there is room. And killed at random moments, after which the same
command has to come to the same result.

<!-- measured: faults -->
<!-- end -->

## Damaged files

Each reader on files with bytes flipped, values replaced by what no result could have, keys and tensors taken out or of
another shape: never a traceback, more than one sentence, 5 seconds, 1 GiB, or a value accepted that could not be.

<!-- measured: fuzz -->
<!-- end -->
"""


def row(outcome: Outcome) -> str:
    """One line for the console."""
    verdict = "ok  " if outcome.passes else "FAIL"
    line = (
        f"{verdict} {outcome.error:8.1e} of {outcome.case.bound:7.0e}  {outcome.seconds:6.2f} s  "
        f"{outcome.case.part}: {outcome.case.name}"
    )
    return line if not outcome.reason else f"{line}\n     {outcome.reason}"


def summary(outcomes: Sequence[Outcome]) -> str:
    failed = sum(not outcome.passes for outcome in outcomes)
    seconds = sum(outcome.seconds for outcome in outcomes)
    return f"{len(outcomes)} cases, {failed} failed, {seconds:.0f} s"


def as_markdown(outcomes: Sequence[Outcome], titles: Mapping[str, str], *, measured: bool = False) -> str:
    """The page, a section for each part, by its title; and those of the measured tables."""
    lines = [HEAD, f"{summary(outcomes)} in all."]
    for part in dict.fromkeys(outcome.case.part for outcome in outcomes):
        own = [outcome for outcome in outcomes if outcome.case.part == part]
        lines += [
            "",
            f"## {titles[part]}",
            "",
            "| case | why it is hard | what is done | worst error | bound | s |",
            "|---|---|---|---:|---:|---:|",
        ]
        before = ("", "")
        for outcome in own:
            case = outcome.case
            about = (case.why, case.done)
            said = ("", "") if about == before else about  # once for all values of a case
            before = about
            cells = (case.name, *said, number(outcome.error), number(case.bound), f"{outcome.seconds:.2f}")
            lines.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n" + (MEASURED if measured else "")


def number(value: float) -> str:
    return "0" if value == 0 else f"{value:.1e}"
