"""The winner among the costs of each pixel on the CPU, of the left image and of the right.

What is done to the costs of a pixel is C on vectors (`wp.func_native`). They stand in a line that
is filled up with the largest value to a multiple of 32: uint16, or float32.
"""

from typing import Any, NamedTuple

import warp as wp

from cvkern.kernels.codes.stereo import Subpixel

# Without fused multiply-add a disparity has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


class Kind(NamedTuple):
    """What C calls costs of one type, and what else it needs to know of them."""

    scalar: Any  # of a line
    index: Any  # an integer of the same size
    cost: str
    most: str  # the largest value
    place: str  # the index
    lesser: str  # of two vectors, the second where the first is NaN
    wide: str  # what differences, and products with 100, fit into


INTEGER = Kind(
    wp.uint16, wp.uint16, "unsigned short", "0xffff", "unsigned short",
    "__builtin_elementwise_min", "int",
)  # fmt: skip
REAL = Kind(
    wp.float32, wp.uint32, "float", "__builtin_inff()", "unsigned int",
    "[](auto a, auto b) { return a < b ? a : b; }", "float",
)  # fmt: skip

_VECTORS = """
    #pragma clang fp contract(off)
    typedef COST costs_of __attribute__((vector_size(64), aligned(4)));
    typedef PLACE places_of __attribute__((vector_size(64), aligned(4)));
    const int width = sizeof(costs_of) / sizeof(COST);
    const costs_of most = (costs_of){} + (COST)MOST;
    places_of rising;
    for (int n = 0; n < width; ++n) rising[n] = n;
"""

# The costs of pixel x of row y into a line.
_COPY = """
    const SOURCE* source = volume.data + ((size_t)y * columns + x) * depth;
    #pragma clang loop vectorize(assume_safety)
    for (int d = 0; d < depth; ++d) line[d] = source[d];
"""

# Of a line: the least cost c, its first place k, and the least cost c2 of places not beside k.
PICK = """
    costs_of low = most, other = most;
    for (int d = 0; d < padded; d += width) {
        const costs_of v = *(const costs_of*)(line + d);
        low = LESSER(v, low);
    }
    const COST c = __builtin_reduce_min(low);
    places_of found = (places_of){} + (PLACE)padded;
    for (int d = 0; d < padded; d += width) {
        const places_of at = *(const costs_of*)(line + d) == c ? rising + (PLACE)d : found;
        found = __builtin_elementwise_min(at, found);
    }
    int k = __builtin_reduce_min(found);
    k = k < depth ? k : 0;
    for (int d = 0; d < padded; d += width) {
        const costs_of v = *(const costs_of*)(line + d);
        const costs_of apart = rising + (PLACE)(d - k + 1) > (PLACE)2 ? v : most;
        other = LESSER(apart, other);
    }
    const COST c2 = __builtin_reduce_min(other);

    const bool alone = k < 2 && k > depth - 3;  // no place but those beside k
    const float infinity = __builtin_inff();
    const float best = c, second = alone ? infinity : (float)c2;
    const float margin = second > best ? 1.0f - best / second : 0.0f;
    float offset = 0.0f;
    if (subpixel != NO_SUBPIXEL && k > 0 && k < depth - 1) {
        const WIDE before = (WIDE)line[k - 1] - (WIDE)c, after = (WIDE)line[k + 1] - (WIDE)c;
        const WIDE greater = before > after ? before : after;
        const float n = before - after, m = subpixel == PARABOLA ? before + after : greater;
        if (0.0f < m && m < infinity && -infinity < n && n < infinity) offset = 0.5f * (n / m);
    }
    const bool rivalled = !alone && (WIDE)c2 * (WIDE)(100 - uniqueness) < (WIDE)c * (WIDE)100;
    const bool unique = uniqueness == 0 || !rivalled;
    const size_t p = (size_t)y * columns + x;
    index.data[p] = unique ? k : -1;
    disparity.data[p] = unique ? (float)(first + k) + offset : __builtin_nanf("");
    cost.data[p] = best;
    confidence.data[p] = margin < 0.0f ? 0.0f : margin > 1.0f ? 1.0f : margin;
"""

# A right pixel's costs stand in as many lines, at x - first - k. What is known of its best match
# has its place in a row from the last column to the first, where it moves with k, behind a margin
# of `padded`. Left pixels come from the last to the first too, k from the largest: a tie is taken.
PICK_RIGHT = """
    const int from = columns - 1 - x + first;
    if (from < columns && from > -depth) {
        COST* b = best_row + padded + from;
        PLACE* p = place_row + padded + from;
        for (int d = 0; d < padded; d += width) {
            const costs_of v = *(const costs_of*)(line + d), old = *(const costs_of*)(b + d);
            const places_of place = *(const places_of*)(p + d);
            *(costs_of*)(b + d) = LESSER(v, old);
            *(places_of*)(p + d) = v <= old ? rising + (PLACE)d : place;
        }
    }
"""

CLEAR_RIGHT = """
    for (int n = 0; n < columns + 2 * padded; ++n) best_row[n] = MOST;
    for (int n = 0; n < columns + 2 * padded; ++n) place_row[n] = padded;
"""

READ_RIGHT = """
    for (int x = 0; x < columns; ++x) {
        const int k = place_row[padded + columns - 1 - x];
        index.data[(size_t)y * columns + x] = k < depth ? k : -1;
    }
"""


def for_kind(text: str, kind: Kind, **names: str) -> str:
    """Write out a text of C on vectors for one kind of costs."""
    names = {
        **names,
        "NO_SUBPIXEL": str(int(Subpixel.NONE)),
        "PARABOLA": str(int(Subpixel.PARABOLA)),
        "COST": kind.cost,
        "PLACE": kind.place,
        "LESSER": kind.lesser,
        "WIDE": kind.wide,
        "MOST": kind.most,
    }
    text = _VECTORS + text
    for name, value in names.items():
        text = text.replace(name, value)
    return text


_SIZES = """
    const int columns = volume.shape[1], depth = volume.shape[2], padded = lines.shape[1];
    COST* const line = lines.data + (size_t)slab * padded;
    for (int d = depth; d < padded; ++d) line[d] = MOST;
"""

_PICK_ROW = f"""
    {_SIZES}
    for (int x = 0; x < columns; ++x) {{
        {_COPY}
        {PICK}
    }}
"""

_PICK_RIGHT_ROW = f"""
    {_SIZES}
    COST* const best_row = best.data + (size_t)slab * best.shape[1];
    PLACE* const place_row = place.data + (size_t)slab * place.shape[1];
    {CLEAR_RIGHT}
    for (int x = columns - 1; x >= 0; --x) {{
        {_COPY}
        {PICK_RIGHT}
    }}
    {READ_RIGHT}
"""


@wp.func_native("""
    const int depth = volume.shape[2];
    for (int x = 0; x < most.shape[1]; ++x) {
        const size_t p = (size_t)y * most.shape[1] + x;
        const unsigned short* from = volume.data + p * depth;
        unsigned short m = 0;
        #pragma clang loop vectorize(assume_safety)
        for (int d = 0; d < depth; ++d) m = from[d] > m ? from[d] : m;
        most.data[p] = m;
    }
""")
def largest_of_row(y: int, volume: wp.array3d[wp.uint16], most: wp.array2d[int]): ...


@wp.kernel
def largest(
    slab: int,
    first_row: int,
    last_row: int,
    volume: wp.array3d[wp.uint16],  # (H, W, D)
    # outputs
    most: wp.array2d[int],  # (H, W)
):
    for y in range(first_row, last_row):
        largest_of_row(y, volume, most)


def _pick(scalar: Any, source: str, kind: Kind) -> wp.Kernel:
    line = kind.scalar

    @wp.func_native(for_kind(_PICK_ROW, kind, SOURCE=source))
    def pick_row(
        slab: int,
        y: int,
        volume: wp.array3d[scalar],
        first: int,
        subpixel: int,
        uniqueness: int,
        lines: wp.array2d[line],
        index: wp.array2d[int],
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
    ): ...

    @wp.kernel
    def pick(
        slab: int,
        first_row: int,
        last_row: int,
        volume: wp.array3d[scalar],  # (H, W, D)
        first: int,
        subpixel: int,
        uniqueness: int,
        # scratch
        lines: wp.array2d[line],  # (slabs, padded)
        # outputs
        index: wp.array2d[int],  # (H, W), as the others
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
    ):
        for y in range(first_row, last_row):
            pick_row(
                slab, y, volume, first, subpixel, uniqueness, lines, index, disparity, cost,
                confidence,
            )  # fmt: skip

    return pick


def _pick_right(scalar: Any, source: str, kind: Kind) -> wp.Kernel:
    line, place_type = kind.scalar, kind.index

    @wp.func_native(for_kind(_PICK_RIGHT_ROW, kind, SOURCE=source))
    def pick_row(
        slab: int,
        y: int,
        volume: wp.array3d[scalar],
        first: int,
        lines: wp.array2d[line],
        best: wp.array2d[line],
        place: wp.array2d[place_type],
        index: wp.array2d[int],
    ): ...

    @wp.kernel
    def pick_right(
        slab: int,
        first_row: int,
        last_row: int,
        volume: wp.array3d[scalar],  # (H, W, D)
        first: int,
        # scratch
        lines: wp.array2d[line],  # (slabs, padded)
        best: wp.array2d[line],  # (slabs, W + 2 padded)
        place: wp.array2d[place_type],  # (slabs, W + 2 padded)
        # outputs
        index: wp.array2d[int],  # (H, W)
    ):
        for y in range(first_row, last_row):
            pick_row(slab, y, volume, first, lines, best, place, index)

    return pick_right


_TYPES = (
    (wp.uint8, "unsigned char", INTEGER),
    (wp.uint16, "unsigned short", INTEGER),
    (wp.float32, "float", REAL),
)
kinds = {scalar: kind for scalar, _, kind in _TYPES}
picks = {scalar: _pick(scalar, *given) for scalar, *given in _TYPES}
picks_right = {scalar: _pick_right(scalar, *given) for scalar, *given in _TYPES}
