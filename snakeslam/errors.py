"""The typed errors of the project; each one knows the exit code a command ends with."""


class SnakeslamError(Exception):
    """Base of every error that a user may get; its text is one line.

    ``exit_code`` is what the command line returns for it.
    """

    exit_code = 1


class InputError(SnakeslamError):
    """A setting, a file or an argument that the user gave is wrong.

    The text says what is wrong, where, and what is allowed.
    """

    exit_code = 2

    def __init__(self, where: str, problem: str, allowed: str | None = None) -> None:
        self.where = where
        self.problem = problem
        self.allowed = allowed
        super().__init__(f"{where}: {problem}" + (f" (allowed: {allowed})" if allowed else ""))


class NotBuiltError(InputError):
    """A setting names a mode that this version does not have yet."""

    def __init__(self, where: str, name: str, built: str) -> None:
        super().__init__(where, f"{name!r} is not built yet", built)


class BackendError(SnakeslamError):
    """A simulator, driver or recording failed while running."""
