"""Photographs with ground truth, which we may not distribute; tests skip without them."""

import os
from pathlib import Path

import pytest


def truth(topic: str) -> Path:
    """Return the folder of a topic under ``CVKERN_DATA``; skip the test where there is none."""
    root = os.environ.get("CVKERN_DATA")
    folder = Path(root or ".") / topic
    if not root or not folder.is_dir():
        pytest.skip(f"CVKERN_DATA names no folder with {topic}")
    return folder
