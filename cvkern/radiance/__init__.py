"""Radiance fields: from posed photographs to a model that renders new views."""

from cvkern.radiance.compositing import (
    Composite,
    CompositeGradient,
    composite_rays,
    composite_rays_backward,
)
from cvkern.radiance.encodings import positional_encoding, spherical_harmonics
from cvkern.radiance.fields.hash import HashField
from cvkern.radiance.fields.perceptron import MLPField
from cvkern.radiance.fields.planes import PlanesField
from cvkern.radiance.fields.splats import SplatField
from cvkern.radiance.fields.voxel import VoxelField
from cvkern.radiance.metrics import psnr, ssim
from cvkern.radiance.models import Mark, Model, load_model
from cvkern.radiance.multiplane.pages import write_planes
from cvkern.radiance.multiplane.pictures import planes_from_depth, planes_from_stereo
from cvkern.radiance.pinhole import Cameras, cameras, look_at, pixel_rays, project
from cvkern.radiance.rendering import Picture, Scores, evaluate, orbit_cameras, render, render_path
from cvkern.radiance.scenes.paths import CameraPath, load_camera_path
from cvkern.radiance.scenes.photographs import Bounds, Scene, load_scene
from cvkern.radiance.scenes.solids import make_scene
from cvkern.radiance.splats.files import load_splats, write_splats
from cvkern.radiance.surfaces import Cloud, Mesh, mesh, point_cloud, write_mesh
from cvkern.radiance.training import fit
from cvkern.radiance.wild.appearance import fit_appearance
from cvkern.radiance.wild.transient import Transient, render_transient

__all__ = [
    "Bounds",
    "CameraPath",
    "Cameras",
    "Cloud",
    "Composite",
    "CompositeGradient",
    "HashField",
    "MLPField",
    "Mark",
    "Mesh",
    "Model",
    "Picture",
    "PlanesField",
    "Scene",
    "Scores",
    "SplatField",
    "Transient",
    "VoxelField",
    "cameras",
    "composite_rays",
    "composite_rays_backward",
    "evaluate",
    "fit",
    "fit_appearance",
    "load_camera_path",
    "load_model",
    "load_scene",
    "load_splats",
    "look_at",
    "make_scene",
    "mesh",
    "orbit_cameras",
    "pixel_rays",
    "planes_from_depth",
    "planes_from_stereo",
    "point_cloud",
    "positional_encoding",
    "project",
    "psnr",
    "render",
    "render_path",
    "render_transient",
    "spherical_harmonics",
    "ssim",
    "write_mesh",
    "write_planes",
    "write_splats",
]
