"""The package's exceptions: one class per kind. Messages name the file or option."""


class RecipeError(Exception):
    """Base of every error that a user can fix; the command line prints it without a traceback."""


class DataError(RecipeError):
    """A dataset, image or id list is missing, damaged or of the wrong shape."""


class ConfigError(RecipeError):
    """An option, architecture or checkpoint does not fit the others."""


class OptionError(ConfigError):
    """The value of an option is invalid, independent of any file."""


class ExportError(RecipeError):
    """An exported file does not compute what the trained network computes."""
