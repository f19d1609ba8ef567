"""Reading text files of users."""

from pathlib import Path

from nunet_models.errors import DataError


def read_text(path: Path, what: str) -> str:
    """The text of `path`, which is expected to be `what`; a byte order mark is skipped.

    # Errors
    `DataError` naming a file that is not in UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"`{path}` is not {what} in UTF-8: {error}") from error
