"""What a user can mend: one sentence that says what, where, and what to do."""

LONGEST = 1000  # characters of a sentence: a value of a file that it quotes may be of any length


class InputError(Exception):
    """Bad input. The command line prints the message alone and exits with code 2."""

    def __str__(self) -> str:
        """The sentence on one line; of an endless one the beginning and the end, where it says what to do."""
        said = " ".join(super().__str__().splitlines())
        return said if len(said) <= LONGEST else f"{said[: LONGEST // 2]} ... {said[-LONGEST // 2 :]}"
