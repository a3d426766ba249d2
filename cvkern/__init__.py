"""Classical computer vision and radiance fields as data-parallel kernels."""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

if _TYPE_CHECKING:
    from cvkern import clouds, images, radiance, scale, torch  # noqa: F401
    from cvkern._capture import capture  # noqa: F401
    from cvkern._runtime import devices, release_memory, use  # noqa: F401
    from cvkern.color import *
    from cvkern.edges import *
    from cvkern.features import *
    from cvkern.filters import *
    from cvkern.geometry import *
    from cvkern.hough import *
    from cvkern.panorama import *
    from cvkern.raw import *
    from cvkern.recognition import *
    from cvkern.reconstruction import *
    from cvkern.shading import *
    from cvkern.stereo import *
    from cvkern.structured_light import *
    from cvkern.transform import *

# Every public name, by the module that defines it. A module is imported when one of its names is
# first used.
_NAMES = {
    "_capture": ("capture",),
    "_runtime": ("devices", "release_memory", "use"),
    "color": (
        "Illusion", "Spectrum", "adapt_colors", "adaptation_matrix", "color_chart",
        "convert_color", "deltaE_ciede2000", "equalize_adapthist", "equalize_hist",
        "estimate_illuminant", "illusion", "lateral_inhibition", "metamer",
        "metameric_difference", "retinex", "spectrum_to_xyz", "standard_light",
        "standard_observer", "white_balance",
    ),
    "edges": ("SubpixelEdges", "canny", "subpixel_edges"),
    "features": (
        "Features", "corner_harris", "corner_peaks", "corner_shi_tomasi", "corner_subpix",
        "match_descriptors", "match_images", "orb", "sift",
    ),
    "filters": (
        "Gradient", "box", "correlate_separable", "gaussian", "gradient", "laplace",
        "median", "prewitt", "scharr", "sobel", "sobel_h", "sobel_v", "threshold_otsu",
    ),
    "geometry": (
        "Calibration", "Camera", "FoundPose", "PlanePose", "Planes", "RecoveredPose",
        "Rectification", "RectifiedPair", "RectifyingMaps", "RobustFit", "RobustFits",
        "StereoCalibration", "calibrate_camera", "calibrate_stereo", "chessboard_points",
        "detect_chessboard", "epipolar_lines", "epipoles", "essential_from_fundamental",
        "find_affine", "find_essential", "find_essentials", "find_fundamental",
        "find_fundamentals", "find_homographies", "find_homography", "find_planes",
        "find_pose", "find_similarity", "fit_affine", "fit_fundamental", "fit_homography",
        "fit_similarity", "pose_from_homography", "project_points", "read_calibration",
        "recover_pose", "rectify_stereo", "rectify_uncalibrated", "sampson_distance",
        "triangulate", "undistort", "undistort_points", "write_calibration",
    ),
    "hough": (
        "CirclePeaks", "Circles", "EllipseVotes", "Ellipses", "HoughLine", "HoughLinePeaks",
        "HoughLineSlope", "LineBins", "LineFit", "RTable", "Shapes", "detect_circles",
        "detect_ellipses", "detect_lines", "detect_segments", "detect_shape", "fit_line",
        "generalized_hough", "generalized_hough_votes", "hough_circle",
        "hough_circle_peaks", "hough_ellipse", "hough_line", "hough_line_peaks",
        "hough_line_segments", "hough_line_slope", "probabilistic_hough_line", "r_table",
        "suggest_line_bins",
    ),
    "panorama": (
        "Panorama", "PhotographMatches", "Recognition", "match_photographs",
        "recognize_panoramas", "stitch",
    ),
    "raw": (
        "Alignment", "align_exposures", "demosaic", "develop", "estimate_response",
        "fit_color_matrix", "fuse_exposures", "merge_exposures", "mosaic", "tone_map",
    ),
    "recognition": ("Codebook", "Objects", "Segmentation", "ShapeModel", "learn_codebook"),
    "reconstruction": (
        "AdjustedBundle", "Reconstruction", "adjust_bundle", "read_reconstruction",
        "reconstruct", "write_reconstruction",
    ),
    "shading": (
        "LambertianGradient", "Mesh", "PhotometricStereo", "ShapeFromShading",
        "estimate_lights", "integrate_normals", "lambertian", "lambertian_backward",
        "lights_from_sphere", "mesh_from_depth", "normals_from_depth", "photometric_stereo",
        "shape_from_shading",
    ),
    "stereo": (
        "DepthFrame", "PairReconstruction", "PointCloud", "StereoMatcher", "StereoResult",
        "Winner", "aggregate_semi_global", "disparity_to_depth", "fill_disparity",
        "guided_median", "left_right_check", "point_cloud", "points_from_disparity",
        "reconstruct_pair", "remove_speckles", "reprojection_matrix", "stereo_cost",
        "stereo_match", "winner_take_all",
    ),
    "structured_light": (
        "GrayCode", "LaserLines", "PhaseShift", "Scan", "calibrate_projector",
        "decode_gray_code", "decode_phase_shift", "detect_laser_lines", "fit_laser_plane",
        "gray_code_patterns", "make_scan", "phase_shift_patterns", "triangulate_columns",
        "triangulate_lines", "unwrap_phase",
    ),
    "transform": (
        "RemapGradient", "pyramid_gaussian", "pyramid_laplacian", "rectify_plane", "remap",
        "remap_backward", "resize", "rotate", "warp_perspective",
    ),
}  # fmt: skip
# Namespaces: their names are not re-exported, as in cvkern.images.read_image.
_NAMESPACES = ("clouds", "images", "radiance", "scale", "torch")

_HOMES = {name: module for module, names in _NAMES.items() for name in names}
_MODULES = {module for module in _NAMES if module[0] != "_"} | set(_NAMESPACES)
__all__ = sorted(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]
__version__ = "0.1.0"


def __getattr__(name: str) -> _Any:
    if name in _HOMES:
        found = getattr(_import_module(f"cvkern.{_HOMES[name]}"), name)
        globals()[name] = found
        return found
    if name in _MODULES:
        return _import_module(f"cvkern.{name}")
    raise AttributeError(f"module 'cvkern' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, *_MODULES})
