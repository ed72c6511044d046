"""What a user can mend: one sentence that says what, where, and what to do."""


class InputError(Exception):
    """Bad input. The command line prints the message alone and exits with code 2."""
