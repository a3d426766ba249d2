"""Votes for circles on the CPU, one thread a slab of rows of the accumulator.

A vote for every pixel of a ring is a sum, over the ring, of the mask moved by the ring's offsets.
Masks are sums of bits, so 512 pixels are added at once: the count of each is a column of bits over
a few vectors, and a full adder takes three bits to two (a population count after Harley and Seal).
The cost does not grow with the number of set pixels, and no two threads write the same vote. What
is done to each row is C (`wp.func_native`), because it becomes vector code as it stands.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp.hough._directions import DIRECTION_CODE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = 512  # pixels added at once

# Copy s of the mask holds its bits s further down: any eight pixels are a byte of one of them.
_PACK = """
    const int columns = mask.shape[1], pitch = bits.shape[2];
    const size_t copy = (size_t)bits.shape[1] * pitch;
    unsigned char* bit = bits.data + (size_t)row * pitch;
    for (int i = 0; i < pitch; ++i) bit[i] = 0;
    if (y >= 0 && y < mask.shape[0]) {
        const unsigned char* from = mask.data + (size_t)y * columns;
        unsigned char* to = bit + left / 8;
        int x = 0;
        for (; x + 8 <= columns; x += 8) {
            unsigned long long eight = 0;
            __builtin_memcpy(&eight, from + x, 8);
            eight |= eight >> 4;
            eight |= eight >> 2;
            eight |= eight >> 1;
            to[x / 8] = ((eight & 0x0101010101010101ull) * 0x0102040810204080ull) >> 56;
        }
        for (; x < columns; ++x) to[x / 8] |= (from[x] != 0) << (x % 8);
    }
    for (int s = 1; s < 8; ++s) {
        unsigned char* moved = bit + s * copy;
        #pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < pitch - 1; ++i) moved[i] = (bit[i] >> s) | (bit[i + 1] << (8 - s));
        moved[pitch - 1] = bit[pitch - 1] >> s;
    }
"""


@wp.func_native(_PACK)
def pack_row(
    mask: wp.array2d[wp.uint8],
    y: int,
    row: int,
    left: int,
    bits: wp.array3d[wp.uint8],
): ...


@wp.kernel
def pack(
    slab: int,
    first: int,
    last: int,
    mask: wp.array2d[wp.uint8],  # (H, W)
    top: int,
    left: int,
    # outputs
    bits: wp.array3d[wp.uint8],  # (8, H + 2 top, pitch)
):
    for row in range(first, last):
        pack_row(mask, row - top, row, left, bits)


@wp.kernel
def place(
    offsets: wp.array2d[int],  # (N, 2)
    top: int,
    left: int,
    bits: wp.array3d[wp.uint8],
    # outputs
    places: wp.array[wp.int64],  # (N,)
):
    """Where the bits moved by an offset begin, in bytes."""
    for i in range(offsets.shape[0]):
        column = left + offsets[i, 1]
        row = (column % 8) * bits.shape[1] + top + offsets[i, 0]
        places[i] = wp.int64(row) * wp.int64(bits.shape[2]) + wp.int64(column // 8)


# A ring has eight offsets or a multiple of them: one a octant.
_RING = """
    typedef unsigned long long Bits __attribute__((vector_size(64)));
    typedef unsigned long long Loaded __attribute__((vector_size(64), aligned(1), may_alias));
    typedef int Counts __attribute__((vector_size(64)));
    typedef float Shares __attribute__((vector_size(64)));
    typedef int Stored __attribute__((vector_size(64), aligned(4), may_alias));
    const auto add = [](Bits& sum, Bits a, Bits b) -> Bits {
        const Bits half = sum ^ a, carry = (sum & a) | (half & b);
        sum = half ^ b;
        return carry;
    };
    const int columns = votes.shape[2], pitch = bits.shape[2];
    const int planes = 32 - __builtin_clz(last - first);
    int* out = votes.data + ((size_t)ring * votes.shape[1] + row) * columns;
    const Counts lane = {1, 1 << 1, 1 << 2, 1 << 3, 1 << 4, 1 << 5, 1 << 6, 1 << 7, 1 << 8, 1 << 9,
                         1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15};
    for (int begin = 0; begin < columns; begin += 512) {
        const unsigned char* from = bits.data + (size_t)row * pitch + begin / 8;
        const auto moved = [&](int k) -> Bits { return *(const Loaded*)(from + places.data[k]); };
        Bits sums[20] = {};
        Bits ones = {}, twos = {}, fours = {};
        for (int k = first; k < last; k += 8) {
            const Bits a = add(ones, moved(k), moved(k + 1));
            const Bits b = add(ones, moved(k + 2), moved(k + 3));
            const Bits c = add(twos, a, b);
            const Bits d = add(ones, moved(k + 4), moved(k + 5));
            const Bits e = add(ones, moved(k + 6), moved(k + 7));
            const Bits f = add(twos, d, e);
            Bits carry = add(fours, c, f);
            for (int p = 3; p < planes; ++p) {
                const Bits both = sums[p] & carry;
                sums[p] ^= carry;
                carry = both;
            }
        }
        sums[0] = ones;
        sums[1] = twos;
        sums[2] = fours;
        for (int i = 0; i < 32 && begin + 16 * i < columns; ++i) {
            Counts count = {};
            for (int p = 0; p < planes; ++p) {
                unsigned short sixteen = 0;
                __builtin_memcpy(&sixteen, (const char*)&sums[p] + 2 * i, 2);
                const Counts set = (((Counts){} + (int)sixteen) & lane) != 0;
                count += set & (1 << p);
            }
            if (shares) {
                const wp::float32 size = (wp::float32)(last - first);
                const Shares share = __builtin_convertvector(count, Shares) / size;
                __builtin_memcpy(&count, &share, 64);
            }
            const int left = columns - begin - 16 * i;
            if (left >= 16) *(Stored*)(out + begin + 16 * i) = count;
            else for (int j = 0; j < left; ++j) out[begin + 16 * i + j] = count[j];
        }
    }
"""


@wp.func_native(_RING)
def vote_row(
    ring: int,
    row: int,
    bits: wp.array3d[wp.uint8],
    places: wp.array[wp.int64],
    first: int,
    last: int,
    shares: bool,
    votes: wp.array3d[int],
): ...


@wp.kernel
def vote_rings(
    slab: int,
    first: int,
    last: int,
    bits: wp.array3d[wp.uint8],  # (8, H + 2 top, pitch)
    places: wp.array[wp.int64],  # (N,)
    starts: wp.array[int],  # (R + 1,)
    shares: bool,
    # outputs
    votes: wp.array3d[int],  # (R, H + 2 pad, W + 2 pad), of float32 if `shares`
):
    for i in range(first, last):
        ring = i // votes.shape[1]
        vote_row(
            ring, i % votes.shape[1], bits, places, starts[ring], starts[ring + 1], shares, votes
        )


# Rows from `first` on of one accumulator: zero them, and cast what votes fall into them.
_DIRECTED = f"""
    const int columns = votes.shape[2], width = orientation.shape[1];
    const int pad = (columns - width) / 2, height = orientation.shape[0];
    int* out = votes.data + (size_t)ring * votes.shape[1] * columns;
    for (size_t i = (size_t)first * columns; i < (size_t)last * columns; ++i) out[i] = 0;
    const int radius = radii.data[ring];
    const int begin = offset_starts.data[ring], end = offset_starts.data[ring + 1];
    const auto vote = [&](int y, int x) {{
        if (y >= first && y < last && x >= 0 && x < columns) ++out[(size_t)y * columns + x];
    }};
    const int top = first - pad - radius, bottom = last - pad + radius;
    const int from = starts.data[top < 0 ? 0 : top > height ? height : top];
    const int to = starts.data[bottom < 0 ? 0 : bottom > height ? height : bottom];
    for (int i = from; i < to; ++i) {{
        const int y = points.data[2 * i], x = points.data[2 * i + 1];
        {DIRECTION_CODE.replace("ANGLE", "orientation.data[(size_t)y * width + x]")}
        if (tolerance < 0) {{
            const int down = (radius * directions.data[2 * code] + 32768) >> 16;
            const int along = (radius * directions.data[2 * code + 1] + 32768) >> 16;
            vote(y + pad + down, x + pad + along);
            vote(y + pad - down, x + pad - along);
            continue;
        }}
        for (int side = 0; side < 2; ++side) {{
            // The offsets stand in the order of their directions: those within the tolerance
            // begin at the first that is not before it, and may run on past the end.
            const int least = (code + side * {DIRECTIONS // 2} - tolerance) & {DIRECTIONS - 1};
            int low = begin, high = end;
            while (low < high) {{
                const int middle = (low + high) / 2;
                if (codes.data[middle] < least) low = middle + 1;
                else high = middle;
            }}
            for (int k = 0; k < end - begin; ++k) {{
                const int at = low + k < end ? low + k : low + k - (end - begin);
                if (((codes.data[at] - least) & {DIRECTIONS - 1}) > 2 * tolerance) break;
                vote(y + pad + offsets.data[2 * at], x + pad + offsets.data[2 * at + 1]);
            }}
        }}
    }}
    if (shares)
        for (size_t i = (size_t)first * columns; i < (size_t)last * columns; ++i) {{
            const wp::float32 share = (wp::float32)out[i] / (wp::float32)(end - begin);
            __builtin_memcpy(out + i, &share, 4);
        }}
"""


@wp.func_native(_DIRECTED)
def vote_along_rows(
    ring: int,
    first: int,
    last: int,
    points: wp.array2d[int],
    starts: wp.array[int],
    orientation: wp.array2d[float],
    radii: wp.array[int],
    directions: wp.array2d[int],
    tolerance: int,
    offsets: wp.array2d[int],
    codes: wp.array[int],
    offset_starts: wp.array[int],
    shares: bool,
    votes: wp.array3d[int],
): ...


@wp.kernel
def vote_directed(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[int],  # (N, 2)
    starts: wp.array[int],  # (H + 1,)
    orientation: wp.array2d[float],  # (H, W)
    radii: wp.array[int],  # (R,)
    directions: wp.array2d[int],  # (DIRECTIONS, 2)
    tolerance: int,
    offsets: wp.array2d[int],  # (M, 2)
    codes: wp.array[int],  # (M,)
    offset_starts: wp.array[int],  # (R + 1,)
    shares: bool,
    # outputs
    votes: wp.array3d[int],  # (R, H + 2 pad, W + 2 pad), of float32 if `shares`
):
    rows = votes.shape[1]
    for ring in range(first // rows, (last + rows - 1) // rows):
        vote_along_rows(
            ring, wp.max(first - ring * rows, 0), wp.min(last - ring * rows, rows), points, starts,
            orientation, radii, directions, tolerance, offsets, codes, offset_starts, shares, votes,
        )  # fmt: skip
