"""The package's exceptions: one class per kind. Messages name the file or option."""


class RecipeError(Exception):
    """Base of every error that a user can fix; the command line prints it without a traceback.

    `hint` says what to do about it, or is None. It is no part of the message.
    """

    def __init__(self, message: str, *, hint: str | None = None) -> None:
        super().__init__(message)
        self.hint = hint


class DataError(RecipeError):
    """A dataset, image or id list is missing, damaged or of the wrong shape."""


class ConfigError(RecipeError):
    """An option, architecture or checkpoint does not fit the others."""


class OptionError(ConfigError):
    """The value of an option is invalid, independent of any file."""


class ExportError(RecipeError):
    """An exported file does not compute what the trained network computes."""


class RenderError(RecipeError):
    """Less was rendered than was asked for."""


def with_hint(message: str, hint: str | None) -> str:
    """A message and its hint in one line, as the command line prints them."""
    return message if hint is None else f"{message}; hint: {hint}"
