"""Functions of the library that PyTorch can differentiate.

Each has the name and the parameters of the function of the library that computes it. Tensors stay
on their device, and their gradients are computed by kernels too. A gradient of a gradient is
refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from cvkern._checks import check_axes, check_integer, check_number, check_pair
from cvkern.filters import linear
from cvkern.radiance import compositing
from cvkern.transform import sampling

__all__ = ["composite_rays", "gaussian", "remap"]

PADS: dict[str, Any] = {
    "nearest": "edge",
    "reflect": "symmetric",
    "mirror": "reflect",
    "wrap": "wrap",
}  # NumPy's


def composite_rays(
    density: Any,
    color: Any,
    distances: Any,
    spans: Any,
    *,
    stop: float = compositing.STOP,
    check: bool = True,
) -> compositing.Composite:
    """Composite the samples of each ray; see :func:`cvkern.radiance.composite_rays`.

    Parameters
    ----------
    density, color : tensor
        As there, with gradients. No sample may belong to two rays.
    distances, spans, stop, check
        As there; without gradients.

    Returns
    -------
    Composite
        Named tuple of tensors.

    Raises
    ------
    ModuleNotFoundError
        If PyTorch is not installed.
    TypeError, ValueError
        As there.

    Examples
    --------
    >>> import torch
    >>> from cvkern.torch import composite_rays
    >>> density = torch.tensor([1.0, 2.0, 0.5], requires_grad=True)
    >>> distances = torch.tensor([[2.0, 0.5], [2.5, 0.5], [2.0, 1.0]])  # and lengths
    >>> spans = torch.tensor([[0, 2], [2, 1]])  # two samples of the first ray, one of the second
    >>> seen = composite_rays(density, torch.rand(3, 3), distances, spans)
    >>> seen.opacity.sum().backward()
    >>> density.grad
    tensor([0.1116, 0.1116, 0.6065])
    """
    apply = _functions()["composite_rays"]
    return compositing.Composite(*apply(density, color, distances, spans, stop, check))


def remap(
    image: Any,
    coordinates: Any,
    order: int = 1,
    *,
    mode: str = "constant",
    cval: float = 0.0,
    channel_axis: int | None = None,
) -> Any:
    """Sample an image at coordinates by a spline; see :func:`cvkern.remap`.

    Parameters
    ----------
    image, coordinates : tensor
        As there, with gradients.
    order, mode, cval, channel_axis
        As there.

    Returns
    -------
    tensor

    Raises
    ------
    ModuleNotFoundError
        If PyTorch is not installed.
    TypeError, ValueError
        As there.

    Examples
    --------
    >>> import torch
    >>> from cvkern.torch import remap
    >>> place = torch.tensor([[[0.0]], [[0.25]]], requires_grad=True)
    >>> remap(torch.tensor([[3.0, 7.0]]), place).sum().backward()
    >>> place.grad.ravel()
    tensor([0., 4.])
    """
    return _functions()["remap"](image, coordinates, order, mode, cval, channel_axis)


def gaussian(
    image: Any,
    sigma: float | Sequence[float] = 1.0,
    *,
    order: int | Sequence[int] = 0,
    mode: str = "reflect",
    cval: float = 0.0,
    truncate: float = 4.0,
    channel_axis: int | None = None,
    batch_axis: int | None = None,
) -> Any:
    """Convolve an image with a Gaussian or one of its derivatives; see :func:`cvkern.gaussian`.

    Parameters
    ----------
    image : tensor
        As there, with gradients.
    sigma, order, mode, cval, truncate, channel_axis, batch_axis
        As there.

    Returns
    -------
    tensor

    Raises
    ------
    ModuleNotFoundError
        If PyTorch is not installed.
    TypeError, ValueError
        As there.

    Notes
    -----
    The gradient is continued by zeros, correlated with the taps reversed, and what falls outside of
    the image is added to the pixels that `mode` takes these values from.

    Examples
    --------
    >>> import torch
    >>> from cvkern.torch import gaussian
    >>> image = torch.zeros(1, 5, requires_grad=True)
    >>> gaussian(image, (0, 0.5))[0, 2].backward()
    >>> image.grad.round(decimals=3)
    tensor([[0.0000, 0.1060, 0.7870, 0.1060, 0.0000]])
    """
    apply = _functions()["gaussian"]
    return apply(image, sigma, order, mode, cval, truncate, channel_axis, batch_axis)


def _gaussian_backward(grad: Any, given: tuple[Any, ...]) -> Any:
    """Return the gradient by the image, from that by the filtered image."""
    torch = _pytorch()
    sigma, order, mode, _, truncate, channel_axis, batch_axis = given
    sigmas = [check_number(s, "sigma", low=0) for s in check_pair(sigma, "sigma")]
    orders = [check_integer(o, "order", 0, 32) for o in check_pair(order, "order")]
    taps = [linear.gaussian_taps(s, o, truncate) for s, o in zip(sigmas, orders, strict=True)]
    axis = check_axes(tuple(grad.shape), channel_axis, batch_axis)
    first = 0 if batch_axis is None else 1
    free = [first + k for k in range(grad.ndim - first) if k != axis]
    sides = [grad.shape[k] for k in free]
    radii = [len(t) // 2 for t in taps]
    shape = list(grad.shape)
    for k, side, radius in zip(free, sides, radii, strict=True):
        shape[k] = side + 2 * radius
    wide = torch.zeros(shape, dtype=torch.float32, device=grad.device)
    inner = wide
    for k, side, radius in zip(free, sides, radii, strict=True):
        inner = inner.narrow(k, radius, side)
    inner.copy_(grad)
    turned = [t[::-1].copy() for t in taps]
    found = linear.correlate_separable(
        wide, turned, mode="constant", channel_axis=channel_axis, batch_axis=batch_axis
    )
    for k, side, radius in zip(free, sides, radii, strict=True):
        if mode == "constant":
            found = found.narrow(k, radius, side)
            continue
        of = np.pad(np.arange(side), radius, mode=PADS[mode])
        folded = torch.zeros_like(found.narrow(k, 0, side).contiguous())
        found = folded.index_add_(k, torch.from_numpy(of).to(grad.device), found)
    return found.contiguous()


def _pytorch() -> Any:
    """Return PyTorch. Type checkers would take ``import torch`` for this module."""
    try:
        return import_module("torch")
    except ModuleNotFoundError:
        raise ModuleNotFoundError("cvkern.torch needs PyTorch: pip install torch") from None


@cache
def _functions() -> dict[str, Any]:
    """Return the functions of PyTorch, which is imported when one of them is first used."""
    torch = _pytorch()
    once_differentiable = torch.autograd.function.once_differentiable

    class CompositeRays(torch.autograd.Function):
        @staticmethod
        def forward(ctx, density, color, distances, spans, stop, check):
            samples = tuple(a.detach() for a in (density, color, distances, spans))
            ctx.save_for_backward(*samples)
            ctx.options = {"stop": stop, "check": check}
            ctx.set_materialize_grads(False)
            return tuple(compositing.composite_rays(*samples, **ctx.options))

        @staticmethod
        @once_differentiable
        def backward(ctx, *gradients):
            samples = ctx.saved_tensors
            if all(gradient is None for gradient in gradients):
                return (None,) * 6
            incoming = compositing.Composite(*gradients)
            found = compositing.composite_rays_backward(incoming, *samples, **ctx.options)
            by = (g.to(a.dtype) for g, a in zip(found, samples, strict=False))
            return (*by, None, None, None, None)

    class Remap(torch.autograd.Function):
        @staticmethod
        def forward(ctx, image, coordinates, order, mode, cval, channel_axis):
            given = image.detach(), coordinates.detach()
            ctx.save_for_backward(*given)
            ctx.options = {"mode": mode, "channel_axis": channel_axis}
            ctx.order = order
            return sampling.remap(*given, order, cval=cval, **ctx.options)

        @staticmethod
        @once_differentiable
        def backward(ctx, grad):
            image, places = ctx.saved_tensors
            found = sampling.remap_backward(grad, image, places, ctx.order, **ctx.options)
            by = found.image.to(image.dtype), found.coordinates.to(places.dtype)
            return (*by, None, None, None, None)

    class Gaussian(torch.autograd.Function):
        @staticmethod
        def forward(ctx, image, *given):
            ctx.given, ctx.dtype = given, image.dtype
            sigma, order, mode, cval, truncate, channel_axis, batch_axis = given
            return linear.gaussian(
                image.detach(), sigma, order=order, mode=mode, cval=cval, truncate=truncate,
                channel_axis=channel_axis, batch_axis=batch_axis,
            )  # fmt: skip

        @staticmethod
        @once_differentiable
        def backward(ctx, grad):
            return (_gaussian_backward(grad, ctx.given).to(ctx.dtype), *[None] * len(ctx.given))

    made = {"composite_rays": CompositeRays, "remap": Remap, "gaussian": Gaussian}
    return {name: function.apply for name, function in made.items()}
