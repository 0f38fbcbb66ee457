"""The file of a picture: in the place of nothing but a picture."""

from pathlib import Path

from gapeval.errors import GapevalError

PNG = b"\x89PNG\r\n\x1a\n"  # how such a file begins


def check_picture(path: Path) -> None:
    """Raises GapevalError rather than replace a log, labels or anything else that is no PNG picture."""
    if path.is_dir():
        raise GapevalError(f"{path}: is a folder; name a file for the picture")
    if not path.exists():
        return
    try:
        with path.open("rb") as file:
            ours = file.read(len(PNG)) == PNG
    except OSError as error:
        raise GapevalError(f"{path}: cannot be replaced: {error.strerror}; name another file") from error
    if not ours:
        raise GapevalError(f"{path}: exists and is no PNG picture; name another file")
