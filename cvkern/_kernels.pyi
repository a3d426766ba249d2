# Written by `python -m tests.kernel_stub`, from the folders of kernels/warp.
class Folder:
    def __init__(self, package: str) -> None: ...
    class clouds:
        from cvkern.kernels.warp.clouds import turntables as turntables
    class color:
        from cvkern.kernels.warp.color import constancy as constancy
        from cvkern.kernels.warp.color import contrast as contrast
        from cvkern.kernels.warp.color import differences as differences
        from cvkern.kernels.warp.color import spaces as spaces
        from cvkern.kernels.warp.color import spectra as spectra
        from cvkern.kernels.warp.color import surroundings as surroundings
    class edges:
        from cvkern.kernels.warp.edges import masks as masks
        from cvkern.kernels.warp.edges import quantiles as quantiles
        from cvkern.kernels.warp.edges import slopes as slopes
        from cvkern.kernels.warp.edges import subpixel as subpixel
    class features:
        from cvkern.kernels.warp.features import binary as binary
        from cvkern.kernels.warp.features import corners as corners
        from cvkern.kernels.warp.features import matching as matching
        class keypoints:
            from cvkern.kernels.warp.features.keypoints import descriptors as descriptors
            from cvkern.kernels.warp.features.keypoints import extrema as extrema
            from cvkern.kernels.warp.features.keypoints import refinement as refinement
            from cvkern.kernels.warp.features.keypoints import selection as selection
            from cvkern.kernels.warp.features.keypoints import windows as windows
    class filters:
        from cvkern.kernels.warp.filters import channels as channels
        from cvkern.kernels.warp.filters import depths as depths
        from cvkern.kernels.warp.filters import gradients as gradients
        from cvkern.kernels.warp.filters import linear as linear
        from cvkern.kernels.warp.filters import medians as medians
    class geometry:
        from cvkern.kernels.warp.geometry import matches as matches
        from cvkern.kernels.warp.geometry import robust as robust
        class cameras:
            from cvkern.kernels.warp.geometry.cameras import chessboards as chessboards
            from cvkern.kernels.warp.geometry.cameras import undistortion as undistortion
    class hough:
        from cvkern.kernels.warp.hough import points as points
        class circles:
            from cvkern.kernels.warp.hough.circles import detection as detection
            from cvkern.kernels.warp.hough.circles import peaks as peaks
            from cvkern.kernels.warp.hough.circles import votes as votes
        class ellipses:
            from cvkern.kernels.warp.hough.ellipses import votes as votes
        class generalized:
            from cvkern.kernels.warp.hough.generalized import votes as votes
        class lines:
            from cvkern.kernels.warp.hough.lines import peaks as peaks
            from cvkern.kernels.warp.hough.lines import progressive as progressive
            from cvkern.kernels.warp.hough.lines import runs as runs
            from cvkern.kernels.warp.hough.lines import segments as segments
            from cvkern.kernels.warp.hough.lines import votes as votes
    class panorama:
        from cvkern.kernels.warp.panorama import blending as blending
        from cvkern.kernels.warp.panorama import seams as seams
        from cvkern.kernels.warp.panorama import warping as warping
    class radiance:
        from cvkern.kernels.warp.radiance import compositing as compositing
        from cvkern.kernels.warp.radiance import encodings as encodings
        from cvkern.kernels.warp.radiance import pinhole as pinhole
        from cvkern.kernels.warp.radiance import rendering as rendering
        class fields:
            from cvkern.kernels.warp.radiance.fields import hash as hash
            class perceptron:
                from cvkern.kernels.warp.radiance.fields.perceptron import heads as heads
                from cvkern.kernels.warp.radiance.fields.perceptron import layers as layers
                from cvkern.kernels.warp.radiance.fields.perceptron import network as network
            class planes:
                from cvkern.kernels.warp.radiance.fields.planes import blending as blending
                from cvkern.kernels.warp.radiance.fields.planes import rays as rays
                from cvkern.kernels.warp.radiance.fields.planes import texels as texels
            class splats:
                from cvkern.kernels.warp.radiance.fields.splats import batches as batches
                from cvkern.kernels.warp.radiance.fields.splats import learning as learning
                from cvkern.kernels.warp.radiance.fields.splats import lists as lists
                from cvkern.kernels.warp.radiance.fields.splats import projection as projection
                from cvkern.kernels.warp.radiance.fields.splats import tiles as tiles
            class voxel:
                from cvkern.kernels.warp.radiance.fields.voxel import nodes as nodes
                from cvkern.kernels.warp.radiance.fields.voxel import rays as rays
        class march:
            from cvkern.kernels.warp.radiance.march import occupancy as occupancy
            from cvkern.kernels.warp.radiance.march import steps as steps
        class scenes:
            from cvkern.kernels.warp.radiance.scenes import solids as solids
        class training:
            from cvkern.kernels.warp.radiance.training import adam as adam
            from cvkern.kernels.warp.radiance.training import background as background
            from cvkern.kernels.warp.radiance.training import losses as losses
        class wild:
            from cvkern.kernels.warp.radiance.wild import appearance as appearance
            from cvkern.kernels.warp.radiance.wild import distractors as distractors
            from cvkern.kernels.warp.radiance.wild import embeddings as embeddings
            from cvkern.kernels.warp.radiance.wild import transient as transient
    class raw:
        from cvkern.kernels.warp.raw import alignment as alignment
        from cvkern.kernels.warp.raw import bands as bands
        from cvkern.kernels.warp.raw import exposures as exposures
        from cvkern.kernels.warp.raw import fusion as fusion
        from cvkern.kernels.warp.raw import grids as grids
        from cvkern.kernels.warp.raw import tone as tone
        class demosaicing:
            from cvkern.kernels.warp.raw.demosaicing import linear as linear
            from cvkern.kernels.warp.raw.demosaicing import menon as menon
            from cvkern.kernels.warp.raw.demosaicing import planes as planes
            from cvkern.kernels.warp.raw.demosaicing import residual as residual
    class recognition:
        from cvkern.kernels.warp.recognition import choices as choices
        from cvkern.kernels.warp.recognition import codebook as codebook
        from cvkern.kernels.warp.recognition import figures as figures
        from cvkern.kernels.warp.recognition import hypotheses as hypotheses
        from cvkern.kernels.warp.recognition import modes as modes
        from cvkern.kernels.warp.recognition import patches as patches
        from cvkern.kernels.warp.recognition import votes as votes
    class reconstruction:
        from cvkern.kernels.warp.reconstruction import adjustment as adjustment
    class shading:
        from cvkern.kernels.warp.shading import meshes as meshes
        from cvkern.kernels.warp.shading import photometry as photometry
        from cvkern.kernels.warp.shading import recovery as recovery
        from cvkern.kernels.warp.shading import rendering as rendering
        class integration:
            from cvkern.kernels.warp.shading.integration import cosines as cosines
            from cvkern.kernels.warp.shading.integration import equations as equations
            from cvkern.kernels.warp.shading.integration import multigrid as multigrid
            from cvkern.kernels.warp.shading.integration import rows as rows
    class stereo:
        from cvkern.kernels.warp.stereo import depth as depth
        from cvkern.kernels.warp.stereo import windows as windows
        from cvkern.kernels.warp.stereo import winners as winners
        class costs:
            from cvkern.kernels.warp.stereo.costs import census as census
            from cvkern.kernels.warp.stereo.costs import correlation as correlation
            from cvkern.kernels.warp.stereo.costs import gray as gray
            from cvkern.kernels.warp.stereo.costs import windows as windows
        class paths:
            from cvkern.kernels.warp.stereo.paths import aggregation as aggregation
            from cvkern.kernels.warp.stereo.paths import matching as matching
        class refinement:
            from cvkern.kernels.warp.stereo.refinement import agreement as agreement
            from cvkern.kernels.warp.stereo.refinement import gaps as gaps
            from cvkern.kernels.warp.stereo.refinement import medians as medians
            from cvkern.kernels.warp.stereo.refinement import speckles as speckles
    class structured_light:
        from cvkern.kernels.warp.structured_light import gray_code as gray_code
        from cvkern.kernels.warp.structured_light import laser as laser
        from cvkern.kernels.warp.structured_light import phase as phase
        from cvkern.kernels.warp.structured_light import triangulation as triangulation
    class transform:
        from cvkern.kernels.warp.transform import projective as projective
        from cvkern.kernels.warp.transform import pyramids as pyramids
        from cvkern.kernels.warp.transform import resampling as resampling
        from cvkern.kernels.warp.transform import sampling as sampling
