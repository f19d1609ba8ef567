"""The package's exceptions: one class a kind, each naming the file or option at fault."""


class RecipeError(Exception):
    """Base of every error that a user can mend; the command line prints it without a traceback."""


class DataError(RecipeError):
    """A dataset, picture or id list is missing, damaged or of the wrong shape."""


class ConfigError(RecipeError):
    """An option, architecture or checkpoint does not fit the others."""


class OptionError(ConfigError):
    """An option has a value that it cannot have, whatever the files hold."""


class ExportError(RecipeError):
    """An exported file does not compute what the trained network computes."""
