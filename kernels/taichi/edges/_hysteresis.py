"""Hysteresis by union-find.

Pixel i of the raster has label i + 1, and label 0 means "strong". The parent of a label is never
larger than the label; a root is its own parent. One thread per pixel joins a pixel with its
neighbours; afterwards, a pixel is an edge if its root is 0.
"""

import taichi as ti

from cvkern.kernels.codes.edges import Edge

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)  # (images, rows, columns)

_BEFORE = ((0, -1), (-1, -1), (-1, 0), (-1, 1))  # neighbours that precede a pixel in the raster


@ti.func
def label_of(states: ti.template(), n: ti.i32, y: ti.i32, x: ti.i32) -> ti.i32:
    return (n * states.shape[1] + y) * states.shape[2] + x + 1


@ti.func
def find(label: ti.i32, parents: ti.template()) -> ti.i32:
    r = label
    while parents[r] != r:
        r = parents[r]
    return r


@ti.func
def join(first: ti.i32, second: ti.i32, parents: ti.template()):
    """Join the trees of two labels below the smaller root, while other threads do the same."""
    a = find(first, parents)
    b = find(second, parents)
    while a != b:
        high = ti.max(a, b)
        b = ti.min(a, b)
        a = ti.atomic_min(parents[high], b)
        if a == high:  # it was still a root, and now hangs below b
            a = b
        else:  # another thread had hung it below a, which must now join b
            a = find(a, parents)
            b = find(b, parents)


@ti.kernel
def plant(
    states: u8_3,
    # outputs
    parents: i32_1,  # (1 + pixels,)
):
    """Make 0 the parent of strong pixels, and all other pixels roots; one thread per pixel."""
    parents[0] = 0
    for n, y, x in states:
        label = label_of(states, n, y, x)
        parents[label] = 0 if states[n, y, x] == Edge.STRONG else label


@ti.kernel
def unite(
    states: u8_3,
    # outputs
    parents: i32_1,
):
    """Join every edge pixel with the edge pixels that precede it; one thread per pixel."""
    for n, y, x in states:
        if states[n, y, x] != Edge.NONE:
            for dy, dx in ti.static(_BEFORE):
                if y + dy >= 0 and 0 <= x + dx < states.shape[2]:
                    if states[n, y + dy, x + dx] != Edge.NONE:
                        label = label_of(states, n, y, x)
                        join(label, label + dy * states.shape[2] + dx, parents)


@ti.kernel
def keep(
    states: u8_3,
    parents: i32_1,
    # outputs
    mask: u8_3,
):
    """Mark the edge pixels whose root is 0; one thread per pixel."""
    for n, y, x in states:
        kept = 0
        if states[n, y, x] != Edge.NONE:
            if find(label_of(states, n, y, x), parents) == 0:
                kept = 1
        mask[n, y, x] = ti.cast(kept, ti.u8)
