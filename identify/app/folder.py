"""The folder that the page works in: which paths are inside it, what lies in it, and where the page keeps its own."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from identify.base.errors import IdentifyError
from identify.scene.toml import is_rig, parsed
from identify.studies.planning import NOT_LOGS

OWN = ".stickslip-app"  # what the page keeps: jobs, drafts of scenes, what was seen in logs
LONGEST_NAME = 240  # bytes: most file systems take 255, and temporary files have some more than their target
DEEPEST = 3  # folders within each other that are listed
MOST_FILES = 5_000
OWN_TABLES = (".map.csv", ".map_boundaries.csv", ".manifest.csv", ".steps.csv")  # as the page names what it has written
NO_LOGS = (*NOT_LOGS, ".tex", ".zip", ".log", *OWN_TABLES)


Document = dict[str, Any]  # a JSON object
Answered = TypeVar("Answered")
INVALID = "the page sent no valid {}; load it again"


class PageError(IdentifyError):
    """What was asked of the page cannot be; the text is the whole sentence. Everything in this room raises it, and lets
    the errors of other rooms pass: the server turns each into an answer."""


@dataclass(frozen=True)
class PageQuery:
    """What the page asks: values by key, each as text, number or JSON."""

    values: Document

    def read(self, key: str, reader: Callable[[Any], Answered], otherwise: object = None) -> Answered:
        """A value as a reader makes it, which raises ValueError and the like where it cannot."""
        try:
            return reader(self.values.get(key, otherwise))
        except (AttributeError, LookupError, TypeError, ValueError, OverflowError):
            raise PageError(INVALID.format(key)) from None

    def text(self, key: str) -> str:
        """A text that must be there."""
        text = self.values.get(key)
        if not text or not isinstance(text, str):
            raise PageError(INVALID.format(key))
        return text

    def whole(self, key: str, otherwise: int) -> int:
        """A whole number of anything."""
        return self.read(key, lambda value: int(float(value)), otherwise)

    def numbers(self, key: str) -> dict[str, float]:
        """Numbers by name."""
        return self.read(key, lambda values: {str(name): float(v) for name, v in (values or {}).items()})


@dataclass(frozen=True)
class Folder:
    """A folder that is served; `root` is absolute and free of links."""

    root: Path

    @staticmethod
    def at(path: str | Path) -> Folder:
        """Raises PageError where it is no folder, or one that cannot be written to."""
        root = Path(os.path.realpath(path))
        if not root.is_dir():
            raise PageError(f"{path} is no folder; give the folder that holds your logs")
        try:
            (root / OWN).mkdir(exist_ok=True)
            tempfile.TemporaryFile(dir=root / OWN).close()
        except OSError as error:
            raise PageError(
                f"{path}: nothing can be written there ({error.strerror}), and the page keeps scenes and results beside"
                " the logs; copy the logs to a folder of your own"
            ) from None
        return Folder(root)

    def path(self, text: object) -> Path:
        """The file or folder that a relative path names; it need not exist."""
        if not isinstance(text, str) or not text or "\0" in text or "\\" in text or len(text) > 1000:
            raise PageError("a path inside the folder was expected; choose a file from the list")
        parts = Path(text).parts
        if any(len(part.encode("utf-8", "surrogatepass")) > LONGEST_NAME for part in parts):
            raise PageError(f"a name of the path has more than {LONGEST_NAME} bytes; choose a shorter one")
        if Path(text).is_absolute() or any(part.startswith(".") for part in parts):
            raise PageError(f"{text!r} is no path inside the folder; choose a file from the list")
        path = self.root / text
        if not Path(os.path.realpath(path)).is_relative_to(self.root):
            raise PageError(f"{text!r} leads out of the folder; copy the file into it")
        return path

    def file(self, text: object) -> Path:
        """As `path`, of a file that is there."""
        path = self.path(text)
        if not path.is_file():
            raise PageError(f"{text}: there is no such file any more; load the list again")
        return path

    def name(self, path: Path) -> str:
        """A path as the page names it: relative, with slashes."""
        return path.relative_to(self.root).as_posix()

    def own(self, *parts: str) -> Path:
        """A place where the page keeps something; its folder is made."""
        path = self.root.joinpath(OWN, *parts)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def found(self) -> dict[str, list[str]]:
        """What lies in it, as sorted paths relative to it: logs, scenes, rigs, folders of fits and of batches."""
        kinds: dict[str, list[str]] = {"logs": [], "scenes": [], "rigs": [], "fits": [], "batches": []}
        for kind, path in islice(self._walked(self.root, DEEPEST), MOST_FILES):
            kinds[kind].append(self.name(path))
        return {kind: sorted(names) for kind, names in kinds.items()}

    def _walked(self, folder: Path, deepest: int) -> Iterator[tuple[str, Path]]:
        with os.scandir(folder) as listed:
            entries = [entry for entry in listed if not entry.name.startswith(".") and entry.name.isprintable()]
        names = {entry.name for entry in entries}
        if "result.json" in names:
            yield "fits", folder
        if "batch.json" in names:
            yield "batches", folder
        # The tables of results are no logs; in the folder of the logs everything is listed, whatever lies there.
        ours = folder != self.root and bool(names & {"result.json", "comparison.json"})
        for entry in entries:
            path, inside = Path(entry.path), Path(os.path.realpath(entry.path))  # also of links that lead to each other
            if entry.is_dir(follow_symlinks=False):
                if deepest and not ours:
                    yield from self._walked(path, deepest - 1)
            elif entry.name.lower().endswith(".toml"):
                kind = "scenes"  # one that cannot be read is a scene to be corrected
                with suppress(OSError, ValueError):
                    kind = "rigs" if is_rig(parsed(path.read_text(encoding="utf-8-sig"))) else kind
                yield kind, path
            elif ours or entry.name in ("index.csv", "captions.txt") or entry.name.lower().endswith(NO_LOGS):
                continue
            elif inside.is_relative_to(self.root) and inside.is_file():
                yield "logs", path


def mapping(value: object) -> Mapping[str, object]:
    """A JSON object that anybody may have written; an empty one for anything else."""
    return value if isinstance(value, Mapping) else {}
