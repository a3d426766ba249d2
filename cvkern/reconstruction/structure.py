"""Structure from motion: from photographs to their cameras, and points of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._ahead import compiles_ahead
from cvkern._checks import check_choice, check_flag, check_integer
from cvkern._files import as_path
from cvkern._runtime import refuse_capture, runtime
from cvkern.geometry.cameras.lens import Camera
from cvkern.panorama.registration import Heap, Progress, check_heap, make_small
from cvkern.reconstruction._arguments import (
    check_cameras,
    check_focals,
    check_names,
    check_pairs,
    lenses_of,
    plan_of,
    read_folder,
)
from cvkern.reconstruction._course import Course, Options, find_models
from cvkern.reconstruction._photographs import MOST_KEYPOINTS
from cvkern.reconstruction._results import finished, nothing
from cvkern.reconstruction.models import Reconstruction
from cvkern.scale.journals import Journal

AHEAD = (
    "geometry.find_essential", "geometry.find_pose", "geometry.find_homography",
    "reconstruction.adjust_bundle", "features.match_images",
)  # fmt: skip
UNKNOWN_AHEAD = "geometry.find_fundamental", *AHEAD  # to find focal lengths as well


def reconstruct(
    images: Any,
    cameras: Camera | Sequence[Camera] | None = None,
    *,
    names: Sequence[str] | None = None,
    focal_lengths: Any = None,
    lens: str = "shared",
    refine: bool = False,
    pairs: Any = "auto",
    neighbors: int = 16,
    models: str = "largest",
    max_keypoints: int = MOST_KEYPOINTS,
    data_range: float | None = None,
    seed: int = 0,
    journal: Any = None,
    progress: Progress | None = None,
) -> Reconstruction:
    """Find the cameras of photographs of a rigid scene, and points of the scene.

    Photographs that could not be placed are named. If the photographs show several scenes, or one
    scene in parts that nothing joins, the result has the one that most of them show. A camera that
    only turns gives no result.

    Parameters
    ----------
    images : sequence of arrays of shape (H, W), (H, W, 3) or (H, W, 4), or path of a folder
        At least two photographs. Those of more than 0.6 megapixels are reduced to that size to find
        keypoints, whose places are between the pixels. Opacity 0 hides keypoints. From a folder,
        all photographs are read in the order of their names, as they are stored (an EXIF
        orientation is ignored); their EXIF focal lengths are used where they have one. A file that
        cannot be read is left out, with a warning.
    cameras : Camera or sequence of Camera, optional
        The known camera of all photographs, or of each. By default the focal length and the lens's
        k1 and k2 are found from three and five photographs on, and the principal point, near the
        middle, from eight on.
    names : sequence of str, optional
        Names of the photographs, for files; by default those of the files, or numbers.
    focal_lengths : float or sequence of float, optional
        Approximate focal lengths in pixels, of all or of each photograph; NaN where unknown.
    lens : {'shared', 'own'}, default 'shared'
        Whether photographs of one size (and one given focal length) have one lens, or each its own.
    refine : bool, default False
        Whether given `cameras` are improved.
    pairs : {'auto', 'all', 'vocabulary', 'sequence'} or array of shape (P, 2), default 'auto'
        The pairs of photographs to compare. 'vocabulary': each photograph with those whose visual
        words are most alike. 'sequence': each one with the next ones, for the frames of a film. An
        array names the pairs by their indices. 'auto' compares all pairs of up to 20 photographs;
        up to 100, each one with those that share most of the 500 strongest keypoints; beyond, it
        is 'vocabulary'.
    neighbors : int, default 16
        How many photographs each one is compared with, except for all and given pairs.
    models : {'largest', 'all'}, default 'largest'
        'all': what has no place in the largest model is reconstructed as well, as far as it can be;
        see ``Reconstruction.others``.
    max_keypoints : int, default 4000
        Largest number of keypoints of a photograph.
    data_range : float, optional
        The value of white. By default 255 for bytes and 1 for floating-point images; for wider
        integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
        2^10 - 1, 2^12 - 1 and so on that no value exceeds.
    seed : int, default 0
        Seed of the samples. Equal photographs, options and seed give equal results.
    journal : path, optional
        A folder in which finished stages are noted, each in a file that is written whole. A run
        that was killed goes on where it was if the call is repeated, and its result is the same.
        The folder is made if missing, and removed in the end.
    progress : function, optional
        Called with the number of completed steps, the number of all steps, and the name of the next
        one.

    Returns
    -------
    Reconstruction
        Poses of all photographs, lenses, points with colours, errors, and which photograph shows
        which point.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    TypeError
        If an image does not hold real numbers, or an option is of the wrong type.
    ValueError
        If there are fewer than two images, one is empty or of another shape, cameras, names or
        focal lengths are not as many as the images or do not match them, `pairs` names others than
        two different images, `journal` is of another call, or an option is out of range.

    See Also
    --------
    write_reconstruction : Write the result for COLMAP or for radiance fields.
    adjust_bundle : The least squares behind it.

    Notes
    -----
    SIFT keypoints of pairs of photographs are matched. Essential matrices verify the pairs, and
    pairs whose turns contradict those of others are left out [3]_, [5]_. Matches are joined to
    tracks; a track never has two places in one photograph.

    Words of the vocabulary are means of the photographs' own descriptors, by k-means. A photograph
    is a list of words, weighted by how rare they are [4]_.

    References
    ----------
    .. [1] J. Schönberger and J.-M. Frahm, "Structure-from-motion revisited", CVPR 2016.
    .. [2] B. Triggs, P. McLauchlan, R. Hartley and A. Fitzgibbon, "Bundle adjustment: a modern
       synthesis", Vision Algorithms, LNCS 1883, 2000.
    .. [3] C. Zach, M. Klopschitz and M. Pollefeys, "Disambiguating visual relations using loop
       constraints", CVPR 2010.
    .. [4] J. Sivic and A. Zisserman, "Video Google: a text retrieval approach to object matching in
       videos", ICCV 2003.
    .. [5] A. Chatterjee and V. M. Govindu, "Efficient and robust large-scale rotation averaging",
       ICCV 2013.

    Examples
    --------
    >>> import cvkern
    >>> from cvkern.radiance import make_scene
    >>> scene = make_scene(layout="forward", train=6, test=0, size=160, texture=True)
    >>> len(cvkern.reconstruct(scene.images, focal_lengths=240).placed)
    6
    """
    refuse_capture("reconstruct")
    check_choice(lens, ("shared", "own"), "lens")
    check_choice(models, ("largest", "all"), "models")
    refine = check_flag(refine, "refine")
    most = check_integer(max_keypoints, "max_keypoints", 1, 2**18)
    neighbors = check_integer(neighbors, "neighbors", 1, 2**31 - 1)
    seed = check_integer(seed, "seed", 0, 2**31 - 1)
    say = progress or (lambda done, total, text: None)
    if isinstance(images, (str, Path)):
        heap, own_names, told = read_folder(as_path(images, "images"), data_range, say)
        names = own_names if names is None else names
        focal_lengths = told if focal_lengths is None and cameras is None else focal_lengths
    else:
        heap = Heap(check_heap(images, data_range), [], np.zeros((0, 2)), [])
    count = len(heap.images)
    if count < 2:
        raise ValueError(f"images must be at least two, got {count}")
    labels = check_names(names, count)
    shapes = [tuple(image.shape[:2]) for image in heap.images]
    given = check_cameras(cameras, shapes)
    focals = check_focals(focal_lengths, count)
    if given is not None and np.isfinite(focals).any():
        raise ValueError("focal_lengths must not be given with cameras, got both")
    options = Options(most, check_pairs(pairs, count), neighbors, models == "all", seed)
    rt = runtime(*heap.images)
    heap = heap if heap.small else make_small(heap.images, data_range)
    plan = {} if journal is None else plan_of(rt, heap, [given, focals, lens, refine], options)
    book = Journal(journal, plan)
    lenses = lenses_of(heap, given, focals, lens == "own", refine)
    with compiles_ahead(*(AHEAD if lenses.told.all() else UNKNOWN_AHEAD)):
        grown = find_models(Course(rt, options, book, say), heap, lenses)
    made = [finished(labels, growth, heap) for growth in grown]
    book.remove()
    if not made:
        return nothing(labels, lenses, heap)
    return replace(made[0], others=tuple(made[1:])) if options.every else made[0]
