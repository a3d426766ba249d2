"""Fixtures shared by the tests of the command."""

import sys

import numpy as np
import pytest

from cvkern.app import cli
from cvkern.images import write_image


@pytest.fixture
def command(monkeypatch, capsys):
    """Return a function that runs the command and gives exit code, output and errors."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["cvkern", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        said = capsys.readouterr()
        return stop.value.code or 0, said.out, said.err

    return run


@pytest.fixture
def photo(tmp_path):
    """Write a grey picture of a disc over a ramp."""
    y, x = np.mgrid[:60, :70]
    image = (40 + x + 100 * (np.hypot(y - 31.3, x - 33.8) < 18)).astype(np.uint8)
    write_image(tmp_path / "photo.png", image)
    return tmp_path / "photo.png"
