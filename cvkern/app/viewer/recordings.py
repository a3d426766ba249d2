"""Recordings that rerun shows: photographs with edges, maps, clouds, and fields with cameras."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

import cvkern
from cvkern._files import replacing
from cvkern.app.viewer.photographs import as_bytes
from cvkern.radiance.models import Model
from cvkern.radiance.rendering import render

MOST = 24  # views of a field


class Recording:
    """A file that is written whole or not at all."""

    def __init__(self, target: Path) -> None:
        try:
            self.rerun: Any = import_module("rerun")
        except ImportError:
            raise ImportError("recordings need rerun: pip install rerun-sdk") from None
        self.target = target
        self.stream = self.rerun.RecordingStream("cvkern")
        self._bytes = self.stream.binary_stream()

    def photograph(self, image: np.ndarray) -> None:
        """Add a photograph and its edges."""
        picture = as_bytes(image)
        edges = cvkern.canny(image, 1.5, 0.7, 0.9, use_quantiles=True, operator="gaussian")
        self.stream.log("photograph", self.rerun.Image(picture))
        self.stream.log("photograph/edges", self.rerun.SegmentationImage(edges.astype(np.uint8)))

    def map(self, values: np.ndarray) -> None:
        """Add a map of depths or disparities."""
        self.stream.log("map", self.rerun.DepthImage(values.astype(np.float32)))

    def cloud(self, points: np.ndarray, colors: np.ndarray | None) -> None:
        """Add points, x right, y down, z forward."""
        self.stream.log("cloud", self.rerun.ViewCoordinates.RDF, static=True)
        self.stream.log("cloud/points", self.rerun.Points3D(points, colors=colors))

    def field(self, model: Model) -> None:
        """Add the views of a field from its cameras, one after the other."""
        rerun, cameras = self.rerun, model.cameras
        self.stream.log("field", rerun.ViewCoordinates.RDF, static=True)
        for view in np.unique(np.linspace(0, len(cameras) - 1, MOST).round().astype(int)).tolist():
            pose, (fx, fy, cx, cy) = cameras.poses[view], cameras.intrinsics[view]
            seen = render(model, cameras, view)
            self.stream.set_time("view", sequence=view)
            self.stream.log(
                "field/camera", rerun.Transform3D(translation=pose[:, 3], mat3x3=pose[:, :3])
            )
            size = [cameras.width, cameras.height]
            lens = rerun.Pinhole(focal_length=[fx, fy], principal_point=[cx, cy], resolution=size)
            self.stream.log("field/camera/picture", lens)
            picture = (255 * seen.color).round().astype(np.uint8)
            self.stream.log("field/camera/picture", rerun.Image(picture))

    def save(self) -> None:
        """Write the file."""
        with replacing(self.target) as beside:
            beside.write_bytes(self._bytes.read())
