"""Write the parts as files, and never over anybody else's."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from skinlab.errors import InputError
from skinlab.io.documents import read_json
from skinlab.io.files import check_can_write, write_file
from skinlab.reproduction.page import page
from skinlab.reproduction.part import Part, Table
from skinlab.reproduction.study import Study

# Which files a run wrote, with their hashes: only these, unchanged, are replaced by the next one.
MANIFEST = "skinlab-paper.json"
PAGE = "paper.md"


class Target:
    """A folder for tables and pictures, and the place of the page.

    Raises:
        InputError: a file is in the way that no earlier run wrote, or that was changed since, or
            the folder cannot be written to. Said before anything is computed.
    """

    def __init__(self, folder: Path, page_path: Path | None = None) -> None:
        """Look at what is there; the page is in the folder unless it has a place of its own."""
        self.folder = folder
        self.page_path = page_path or folder / PAGE
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: is not a folder")
        self._ours = self._read_manifest()
        if page_path is not None and not page_path.parent.is_dir():
            raise InputError(f"{page_path}: its folder does not exist")

    def check(self, parts: Sequence[str]) -> None:
        """Refuse if a file that these parts may become is in the way, or cannot be written.

        Raises:
            InputError: see the class.
        """
        for path in (self.folder / "times.csv", self.page_path):
            check_can_write(path)
        names = [f"{part}.{kind}" for part in parts for kind in ("csv", "png")]
        for path in (*(self.folder / name for name in (*names, "times.csv")), self.page_path):
            if path.exists() and self._ours.get(self._key(path)) != _hash(path.read_bytes()):
                raise InputError(
                    f"{path}: exists and is not what an earlier run of this command wrote; "
                    "move it, or choose another folder"
                )

    def write(self, study: Study, parts: Sequence[Part], times: Table) -> list[Path]:
        """Write everything; return the paths, the page first.

        Raises:
            InputError: something cannot be written.
        """
        files: dict[Path, bytes] = {
            self.page_path: page(study, parts, self._link).encode(),
            **{self.folder / f"{p.name}.csv": p.table.csv().encode() for p in parts},
            **{self.folder / f"{p.name}.png": picture(p) for p in parts if p.draw is not None},
            self.folder / "times.csv": times.csv().encode(),
        }
        self._write_manifest({**self._ours, **{self._key(p): _hash(b) for p, b in files.items()}})
        for path, content in files.items():
            write_file(path, content, replace=True)
        return list(files)

    def _link(self, name: str) -> str:
        path = os.path.relpath(self.folder / name, self.page_path.parent)
        return Path(path).as_posix()

    def _key(self, path: Path) -> str:
        return Path(os.path.relpath(path, self.folder)).as_posix()

    def _read_manifest(self) -> Mapping[str, str]:
        path = self.folder / MANIFEST
        try:
            found = read_json(path.read_text(encoding="utf-8"))
            files = found["files"]
            return {str(name): str(value) for name, value in files.items()}
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise InputError(
                f"{path}: not readable as the list of what an earlier run wrote; "
                "move it, or choose another folder"
            ) from None

    def _write_manifest(self, files: Mapping[str, str]) -> None:
        document = {"schema": "skinlab.paper/1", "files": dict(sorted(files.items()))}
        text = json.dumps(document, indent=1) + "\n"
        write_file(self.folder / MANIFEST, text, replace=True)


def picture(part: Part) -> bytes:
    """Return the part's picture as PNG."""
    from matplotlib.figure import Figure

    assert part.draw is not None
    figure = Figure(figsize=part.size, dpi=110, layout="constrained")
    part.draw(figure)
    for ax in figure.axes:
        ax.spines[["top", "right"]].set_visible(False)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": "skinlab"})
    return stream.getvalue()


def _hash(content: bytes) -> str:
    return "sha256:" + hashlib.sha256(content).hexdigest()
