"""Finished parts of a run on disk, so that a killed run goes on where it was."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._archives import DAMAGED
from cvkern._files import as_path, replacing, write_text


class Journal:
    """A folder with one file for each finished part; without a path, nothing is kept."""

    def __init__(self, path: Any, plan: dict[str, Any]) -> None:
        self.folder: Path | None = None if path is None else as_path(path, "journal")
        if self.folder is None:
            return
        text = json.dumps(plan, sort_keys=True, default=_digest)
        file = self.folder / "plan.json"
        if file.exists():
            if file.read_text(encoding="utf-8") != text:
                raise ValueError(
                    f"journal must be of the same call, got that of another in {str(path)!r}: "
                    "remove it to begin anew"
                )
        elif self.folder.exists() and any(self.folder.iterdir()):
            raise ValueError(f"journal must name a new or empty folder, got {str(path)!r}")
        else:
            self.folder.mkdir(exist_ok=True)
            write_text(file, text)

    @property
    def begun(self) -> bool:
        """Whether some part is finished already."""
        return self.folder is not None and next(self.folder.glob("*.npz"), None) is not None

    def note(self, part: int | str, kept: dict[str, np.ndarray]) -> None:
        """Note that a part is finished, a tile for example, and keep the given arrays of it."""
        if self.folder is not None:
            with replacing(self.folder / f"{part}.npz") as beside, open(beside, "wb") as stream:
                np.savez(stream, done=np.ones(1, bool), **kept)  # pyright: ignore[reportArgumentType]

    def kept(self, part: int | str) -> dict[str, np.ndarray] | None:
        """Return the arrays of a finished part, or None if it is missing or its file is damaged."""
        if self.folder is None or not (self.folder / f"{part}.npz").exists():
            return None
        try:
            with np.load(self.folder / f"{part}.npz", allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files if name != "done"}
        except DAMAGED:
            return None

    def remove(self) -> None:
        """Remove the journal of a finished run."""
        if self.folder is not None:
            for file in [*self.folder.glob("*.npz"), self.folder / "plan.json"]:
                file.unlink(missing_ok=True)
            self.folder.rmdir()


def _digest(value: Any) -> Any:
    """Return something JSON can hold in place of an array or another object."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(value.tobytes()).hexdigest()
        return [list(value.shape), str(value.dtype), digest]
    return repr(type(value))
