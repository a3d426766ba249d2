"""``cvkern nerf``: train, render, judge and export radiance fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import (
    Backend,
    Device,
    Overwrite,
    Seed,
    check_apart,
    check_new,
    progress_bar,
)
from cvkern.app.commands._scenes import SceneAt, check_kind, fade, scene_at, with_settings, within

nerf = typer.Typer(help="Radiance fields: new views from posed photographs.", no_args_is_help=True)

PAGES = ".html", ".png"  # files of planes
ModelAt = Annotated[Path, typer.Argument(metavar="MODEL", help="Model to read, .npz.")]
Shrink = Annotated[
    int, typer.Option(help="Side of the blocks of pixels to average photographs over.")
]
Size = Annotated[float, typer.Option(help="Size of the pictures relative to the photographs.")]


@nerf.command()
def train(
    scene: SceneAt,
    output: Annotated[Path, typer.Option("--output", "-o", help="Model to write, .npz.")],
    field: Annotated[
        str | None,
        typer.Option(
            help="Kind: voxel, hash, mlp or splats, in a size that suits the device, or planes, "
            "for photographs from one side.",
            show_default="voxel on the CPU, hash on a GPU",
        ),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            help="Time to train for; compiling, evaluation and saving come on top.",
            show_default="60",
        ),
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Steps to train for, instead.")] = None,
    background: Annotated[
        str | None,
        typer.Option(
            help="Background: random, white, black or learnt.",
            show_default="random, or what the photographs' borders show",
        ),
    ] = None,
    loss: Annotated[str, typer.Option(help="Loss: squared or huber.")] = "squared",
    appearance: Annotated[
        str | None,
        typer.Option(
            help="Learn the light of each photograph: affine, a map of its colours, or embedding, "
            "inputs of a hash or mlp field.",
            show_default="one light",
        ),
    ] = None,
    gauge: Annotated[
        int | None,
        typer.Option(help="Photograph whose light pictures have.", show_default="the first"),
    ] = None,
    robust: Annotated[
        bool, typer.Option("--robust", help="Ignore passers-by and what else does not stay.")
    ] = False,
    transient: Annotated[
        bool, typer.Option("--transient", help="Learn what passes in front of each photograph.")
    ] = False,
    seed: Seed = 0,
    deterministic: Annotated[
        bool, typer.Option("--deterministic", help="The same steps give the same model on a GPU.")
    ] = False,
    devices: Annotated[
        str | None,
        typer.Option(metavar="cuda:0,cuda:1,...", help="Train on several GPUs together."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue from the output, if it exists.")
    ] = False,
    bounds: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,HALF",
            help="Middle and half side of the cube to fill, in the scene's units.",
        ),
    ] = None,
    near: Annotated[
        float | None, typer.Option(help="Distance from a camera at which rays begin.")
    ] = None,
    far: Annotated[
        float | None, typer.Option(help="Distance from a camera at which rays end.")
    ] = None,
    test_every: Annotated[
        int, typer.Option(help="Hold out one in this many photographs, 0 for none.")
    ] = 8,
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="A setting of the field; repeatable."),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            help="Log to write, .csv, or a folder for TensorBoard; --resume continues it."
        ),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Show the field in the browser while it trains.")
    ] = False,
    shrink: Shrink = 1,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Train a radiance field, and write the model; Ctrl-C stops and writes the model so far.

    With --resume, --seconds and --steps count from the beginning of the first run.
    """
    from cvkern.radiance import fit

    check_new(output, "output", overwrite or resume, "--resume goes on with it, ")
    if log is not None and log.suffix:
        check_new(log, "log", overwrite or resume, "--resume goes on with it, ")
    with cvkern.use(backend=backend, device=device):
        model = fit(
            within(scene_at(scene, shrink, test_every), bounds, near, far),
            with_settings(field, setting) if setting else field,
            seconds=seconds,
            steps=steps,
            background=background,
            loss=loss,
            appearance=appearance,
            gauge=gauge,
            robust=robust,
            transient=transient,
            seed=seed,
            deterministic=deterministic,
            devices=devices.split(",") if devices else None,
            checkpoint=output,
            resume=resume,
            log=log,
            viewer=view,
        )
    done = model.training
    said = f"{output}: 1 step"  # the time of the first step is not counted
    if done.step > 1:
        rate = done.total_rays / done.seconds
        said = f"{output}: {done.step} steps in {done.seconds:.1f} s, {rate:,.0f} rays/s"
    if done.stopped:
        said += ", stopped"
    elif done.marks and done.marks[-1].test_psnr == done.marks[-1].test_psnr:
        last = done.marks[-1]
        said += f", held-out views {last.test_psnr:.2f} dB, SSIM {last.test_ssim:.3f}"
    typer.echo(said)


@nerf.command()
def render(
    model: ModelAt,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Picture to write; a film is .gif, or .mp4 if imageio-ffmpeg is installed.",
        ),
    ],
    view: Annotated[
        int, typer.Option(help="Number, from 0, of the photograph whose camera to use.")
    ] = 0,
    orbit: Annotated[
        bool, typer.Option("--orbit", help="A film from cameras around the scene.")
    ] = False,
    path: Annotated[
        Path | None,
        typer.Option(
            help="A film along the cameras of a file: nerfstudio's camera_path.json, or a "
            "transforms.json."
        ),
    ] = None,
    frames: Annotated[int, typer.Option(help="Of the orbit.")] = 60,
    fps: Annotated[
        float | None,
        typer.Option(help="Frames per second.", show_default="those of the path's file, or 20"),
    ] = None,
    size: Size = 1.0,
    light: Annotated[
        int | None,
        typer.Option(
            help="Number of the photograph whose light to use.", show_default="the model's"
        ),
    ] = None,
    light_to: Annotated[
        int | None,
        typer.Option(help="Photograph whose light a film ends in; it begins in that of --light."),
    ] = None,
    depth: Annotated[
        Path | None,
        typer.Option(
            help="Depths to write: a picture, bright means near, or .npy: float32, in the scene's "
            "units, NaN where nothing is."
        ),
    ] = None,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Render a view of a model, an orbit, or a film along a camera path."""
    from cvkern._checks import check_positive
    from cvkern._files import replacing
    from cvkern.images.colors import apply_colormap
    from cvkern.images.files import write_image
    from cvkern.radiance import load_camera_path, load_model, orbit_cameras, render_path
    from cvkern.radiance import render as picture_of

    if orbit and path:
        raise ValueError(f"path must not go with an orbit, got {str(path)!r}")
    film = orbit or path is not None
    check_kind(film, depth, light_to)
    raw = depth is not None and depth.suffix.lower() == ".npy"
    check_new(output if film else None, "output", overwrite)
    check_new(depth if raw else None, "depth", overwrite)
    check_positive(size, "size")
    check_apart((), output=output, depth=depth)
    with cvkern.use(backend=backend, device=device):
        made = load_model(model)
        if film:
            if path is None:
                cameras, rate = orbit_cameras(made.cameras, frames, factor=size), 20.0
            else:
                cameras, rate = load_camera_path(path, made.cameras, factor=size)
            with progress_bar() as bar:
                task = bar.add_task("Rendering", total=len(cameras))
                render_path(
                    made, cameras, output, fps=rate if fps is None else fps,
                    appearance=fade(made, light, light_to, len(cameras)),
                    progress=lambda done, total: bar.update(task, completed=done, total=total),
                )  # fmt: skip
            typer.echo(f"{output}: {len(cameras)} frames of {cameras.height} x {cameras.width}")
            return
        cameras = made.cameras.scaled(size)
        seen = picture_of(made, cameras, view, appearance=light)
    write_image(output, np.round(255 * seen.color).astype(np.uint8))
    if depth and raw:
        with replacing(depth) as beside:
            np.save(beside, np.asarray(seen.depth, np.float32), allow_pickle=False)
    elif depth:
        write_image(depth, apply_colormap(-seen.depth, nan=(0, 0, 0)))
    typer.echo(f"{output}: {cameras.height} x {cameras.width}")


@nerf.command(name="eval")
def judge(
    model: ModelAt,
    scene: SceneAt,
    shrink: Shrink = 1,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Compare a model with the held-out photographs of a scene."""
    from cvkern.radiance import evaluate, load_model

    with cvkern.use(backend=backend, device=device):
        photographs = scene_at(scene, shrink)
        made = load_model(model)
        with progress_bar() as bar:
            task = bar.add_task("Rendering", total=None)
            scores = evaluate(
                made, photographs,
                progress=lambda done, total: bar.update(task, completed=done, total=total),
            )  # fmt: skip
    for view, psnr, ssim in zip(photographs.test.nonzero()[0], *scores, strict=True):
        typer.echo(f"view {view}: {psnr:.2f} dB, SSIM {ssim:.3f}")
    typer.echo(
        f"mean of {len(scores.psnr)}: {scores.psnr.mean():.2f} dB, SSIM {scores.ssim.mean():.3f}"
    )


@nerf.command()
def export(
    model: ModelAt,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="PLY or GLB to write (a mesh needs scikit-image), or a smaller model, .npz, for "
            "rendering only. Of planes: a page for a browser, .html, or an atlas, .png. Of splats: "
            "these, as viewers read them, .ply.",
        ),
    ],
    points: Annotated[
        bool, typer.Option("--points", help="Write a point cloud instead of a mesh.")
    ] = False,
    resolution: Annotated[int, typer.Option(help="Cells of the mesh along a side.")] = 128,
    density: Annotated[float, typer.Option(help="Density at the surface of the mesh.")] = 10.0,
    pieces: Annotated[
        int, typer.Option(help="Pieces of the mesh to keep, the largest first; 0 for all.")
    ] = 1,
    reference: Annotated[
        int, typer.Option(help="Reference camera whose planes become a page or an atlas.")
    ] = 0,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Write a model as a coloured mesh, as a point cloud, as a page, or as a smaller model."""
    from cvkern import radiance

    if output.suffix.lower() not in (".ply", ".glb", ".npz", *PAGES):
        raise ValueError(f"output must end in .ply, .glb, .npz, .html or .png, got {str(output)!r}")
    if points and output.suffix.lower() == ".glb":
        raise ValueError(f"output must end in .ply for points, got {str(output)!r}")
    check_new(output, "output", overwrite)
    with cvkern.use(backend=backend, device=device):
        made = radiance.load_model(model)
        if output.suffix.lower() in (".npz", *PAGES):
            if output.suffix.lower() == ".npz":
                made.save(output, resumable=False)
            else:
                radiance.write_planes(made, output, reference=reference)
            typer.echo(f"{output}: {output.stat().st_size / 2**20:.1f} MiB")
            return
        if points:
            from cvkern.clouds import write_ply

            cloud = radiance.point_cloud(made)
            write_ply(output, *cloud)
            typer.echo(f"{output}: {len(cloud.points)} points")
        elif isinstance(made.settings, radiance.SplatField) and output.suffix.lower() == ".ply":
            radiance.write_splats(output, made)
            typer.echo(f"{output}: {made.settings.splats} splats")
        else:
            surface = radiance.mesh(
                made, resolution=resolution, density=density, pieces=pieces or None
            )
            radiance.write_mesh(output, surface)
            typer.echo(f"{output}: {len(surface.faces)} triangles")


@nerf.command()
def planes(
    left: Annotated[Path, typer.Argument(metavar="LEFT", help="Left image.")],
    right: Annotated[Path, typer.Argument(metavar="RIGHT", help="Right image, rectified.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Page to write, .html, that a browser shows and the mouse moves; or an atlas, "
            ".png, or a model, .npz.",
        ),
    ],
    min_disparity: Annotated[int, typer.Option(help="Smallest disparity, pixels.")] = 0,
    max_disparity: Annotated[int, typer.Option(help="End of the disparities, pixels.")] = 64,
    count: Annotated[int, typer.Option(help="Number of planes.")] = 32,
    focal: Annotated[
        float | None,
        typer.Option(help="Focal length, pixels.", show_default="the width of the images"),
    ] = None,
    baseline: Annotated[float, typer.Option(help="Distance between the cameras.")] = 1.0,
    doffs: Annotated[
        float, typer.Option(help="Right principal point minus the left one, pixels.")
    ] = 0.0,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Make a multiplane image of a rectified pair, without training: views between the two."""
    from cvkern.images.files import read_image
    from cvkern.radiance import planes_from_stereo, write_planes

    if output.suffix.lower() not in (".npz", *PAGES):
        raise ValueError(f"output must end in .html, .png or .npz, got {str(output)!r}")
    check_new(output, "output", overwrite)
    check_apart((left, right), output=output)
    photos = [read_image(path) for path in (left, right)]
    photos = [np.dstack([p] * 3) if p.ndim == 2 else p[..., :3] for p in photos]
    height, width = photos[0].shape[:2]
    length = float(width) if focal is None else focal
    K = [[length, 0, (width - 1) / 2], [0, length, (height - 1) / 2], [0, 0, 1]]
    with cvkern.use(backend=backend, device=device):
        made = planes_from_stereo(
            photos[0], photos[1], K, disparities=(min_disparity, max_disparity), baseline=baseline,
            doffs=doffs, planes=count,
        )  # fmt: skip
        if output.suffix.lower() == ".npz":
            made.save(output)
        else:
            write_planes(made, output)
    typer.echo(f"{output}: {count} planes of {height} x {width}")
