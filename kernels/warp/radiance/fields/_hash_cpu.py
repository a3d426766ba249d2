"""Hash encoding on the CPU, in float32: a level at a time, many samples at a time in a vector."""

import warp as wp

from cvkern.kernels.codes.radiance import HASH_PRIMES

wp.set_module_options({"enable_backward": False})

# Where sample `s` is in its level, for positions from 0 to 1: to cut is to round down.
_CELL = """
    const float at_i = at[3 * s] * n, at_j = at[3 * s + 1] * n, at_k = at[3 * s + 2] * n;
    int ci = (int)at_i, cj = (int)at_j, ck = (int)at_k;
    ci = ci < 0 ? 0 : ci > cells - 1 ? cells - 1 : ci;  // positions at 1 are in the last cell
    cj = cj < 0 ? 0 : cj > cells - 1 ? cells - 1 : cj;
    ck = ck < 0 ? 0 : ck > cells - 1 ? cells - 1 : ck;
    const float fi = at_i - (float)ci, fj = at_j - (float)cj, fk = at_k - (float)ck;
"""

# One corner of it: the bits of its number say on which sides of the cell it is.
_CORNER = """{
    const int i = ci + (CORNER & 1), j = cj + (CORNER >> 1 & 1), k = ck + (CORNER >> 2);
    const int entry = PLACE;
    const float share = ((CORNER & 1) ? fi : 1.0f - fi) * ((CORNER & 2) ? fj : 1.0f - fj)
        * ((CORNER & 4) ? fk : 1.0f - fk);
    USE
}"""

_DENSE = "(k * (cells + 1) + j) * (cells + 1) + i"
_HASHED = "(int)(((unsigned)i ^ (unsigned)j * {}u ^ (unsigned)k * {}u) & mask)".format(*HASH_PRIMES)

_LEVEL = """
    const int cells = resolutions.data[level], begins = offsets.data[level];
    const int size = offsets.data[level + 1] - begins;
    const unsigned mask = (unsigned)size - 1u;
    const float n = (float)cells;
    const bool dense = (long long)(cells + 1) * (cells + 1) * (cells + 1) <= size;
"""


def _corners(place: str, use: str) -> str:
    """Return C that uses all corners of a cell."""
    corner = _CORNER.replace("PLACE", place).replace("USE", use)
    return _CELL + "".join(corner.replace("CORNER", str(c)) for c in range(8))


def _both(loop: str, use: str) -> str:
    """Return C of a loop over samples, for levels that hold all corners and for hashed ones."""
    dense, hashed = (loop.replace("CORNERS", _corners(p, use)) for p in (_DENSE, _HASHED))
    return f"if (dense) {{ {dense} }} else {{ {hashed} }}"


_ENCODE = """
    #pragma clang loop vectorize(assume_safety)
    for (int s = begin; s < end; ++s) {
        float x = 0.0f, y = 0.0f;
        CORNERS
        to[pitch * s] = x;
        to[pitch * s + 1] = y;
    }
"""


@wp.func_native(f"""
    #pragma clang fp contract(fast)
    const int samples = positions.shape[0], pitch = features.shape[1];
    const int known = total.data[0] < samples ? total.data[0] : samples;
    const float* at = positions.data;
    for (int level = first / samples; level * samples < last; ++level) {{
        {_LEVEL}
        const int lowest = level * samples;
        const int begin = first > lowest ? first - lowest : 0;
        const int end = last - lowest < known ? last - lowest : known;
        const float* entries = table.data + 2 * (size_t)begins;
        float* to = features.data + 2 * level;
        {_both(_ENCODE, "x += share * entries[2 * entry]; y += share * entries[2 * entry + 1];")}
    }}
""")
def look_up(
    first: int,
    last: int,
    positions: wp.array2d[float],
    total: wp.array[int],
    resolutions: wp.array[int],
    offsets: wp.array[int],
    table: wp.array2d[float],
    features: wp.array2d[float],
): ...


@wp.kernel
def encode(
    slab: int,
    first: int,
    last: int,
    positions: wp.array2d[float],  # (M, 3), in [0, 1]
    total: wp.array[int],  # (1,)
    resolutions: wp.array[int],  # (L,)
    offsets: wp.array[int],  # (L + 1,)
    table: wp.array2d[float],  # (entries, 2)
    # outputs
    features: wp.array2d[float],  # (M, 2 L)
):
    """Make the features from item `first` to `last`, the samples of a level after another's."""
    look_up(first, last, positions, total, resolutions, offsets, table, features)


BATCH = 64  # samples whose corners are found before any is added to

_PLACES = """
    #pragma clang loop vectorize(assume_safety)
    for (int b = 0; b < count; ++b) {
        const int s = start + b;
        CORNERS
    }
"""
_KEEP = f"places[{BATCH} * CORNER + b] = entry; shares[{BATCH} * CORNER + b] = share;"


# A feature is a weighted sum of entries: an entry's gradient is its weight times that.
@wp.func_native(f"""
    const int samples = positions.shape[0], pitch = d_features.shape[1];
    const int known = total.data[0] < samples ? total.data[0] : samples;
    const float* at = positions.data;
    int places[8 * {BATCH}];
    float shares[8 * {BATCH}];
    for (int level = first; level < last; ++level) {{
        {_LEVEL}
        float* entries = d_table.data + 2 * (size_t)begins;
        for (int start = 0; start < known; start += {BATCH}) {{
            const int count = known - start < {BATCH} ? known - start : {BATCH};
            {_both(_PLACES, _KEEP)}
            for (int b = 0; b < count; ++b) {{
                const float* d = d_features.data + (size_t)(start + b) * pitch + 2 * level;
                const float dx = d[0], dy = d[1];
                if (dx == 0.0f && dy == 0.0f) continue;
                for (int corner = 0; corner < 8; ++corner) {{
                    float* to = entries + 2 * places[{BATCH} * corner + b];
                    to[0] += shares[{BATCH} * corner + b] * dx;
                    to[1] += shares[{BATCH} * corner + b] * dy;
                }}
            }}
        }}
    }}
""")
def scatter(
    first: int,
    last: int,
    positions: wp.array2d[float],
    total: wp.array[int],
    resolutions: wp.array[int],
    offsets: wp.array[int],
    d_features: wp.array2d[float],
    d_table: wp.array2d[float],
): ...


@wp.kernel
def backward(
    slab: int,
    first: int,
    last: int,
    positions: wp.array2d[float],  # (M, 3), in [0, 1]
    total: wp.array[int],  # (1,)
    resolutions: wp.array[int],  # (L,)
    offsets: wp.array[int],  # (L + 1,)
    d_features: wp.array2d[float],  # (M, 2 L)
    # outputs
    d_table: wp.array2d[float],  # (entries, 2): added to
):
    """Add the gradients of levels `first` to `last`: no two threads add to one entry."""
    scatter(first, last, positions, total, resolutions, offsets, d_features, d_table)
