"""Files appear whole or not at all: written beside the target under another name, then moved."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path in the target's folder; move it to `path` on success, delete it on any exception.

    The temporary name keeps the suffix, because writers choose a format by it. KeyboardInterrupt counts as an
    exception. The target's folder must exist (`OSError` otherwise); a link is followed, not replaced.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise IsADirectoryError(f"{path}: this is a folder; a file name was expected; add one")
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{path}: its folder does not exist; create the folder or choose another one")
    temporary = target.parent / f".{secrets.token_hex(8)}.part{target.suffix[:16]}"
    try:
        yield temporary
        descriptor = os.open(temporary, os.O_RDWR)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        temporary.replace(target)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno and error.filename in (None, str(temporary)):
            error.filename = str(path)  # a full disk does not say what was written
        raise


@contextmanager
def atomic_write(path: str | Path, mode: str = "w") -> Iterator[IO[Any]]:
    """Yield a handle ("w": UTF-8 text, newlines as written; "wb": bytes) whose content reaches `path` only whole."""
    if mode not in ("w", "wb"):
        raise ValueError(f'mode {mode!r} was given; "w" or "wb" was expected')
    encoding, newline = ("utf-8", "") if mode == "w" else (None, None)
    with atomic_path(path) as temporary, temporary.open(mode, encoding=encoding, newline=newline) as handle:
        yield handle


@contextmanager
def atomic_hdf5(path: str | Path, **options: Any) -> Iterator[h5py.File]:
    """Yield a new HDF5 file that is built in memory and reaches `path` only whole.

    The HDF5 library may end the process where a disk fills while it writes; plain bytes fail with an `OSError`.

    Args:
        path: a file of this name is replaced.
        options: as of `h5py.File`.
    """
    import h5py

    with h5py.File(Path(path).name, "w", driver="core", backing_store=False, block_size=(1 << 22), **options) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    with atomic_write(path, "wb") as handle:
        handle.write(image)
