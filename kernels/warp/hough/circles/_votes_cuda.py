"""Votes for circles on CUDA.

As in _votes_cpu.py the votes of a ring are sums of moved masks, a bit a pixel: a thread adds 32
pixels at once, in two rows, and full adders take three bits to two. Along the gradient, where a
point has few votes, they are added one by one.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp.hough._directions import direction_code

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = 256
ROWS = 2  # of a thread
HALF_TURN = wp.constant(DIRECTIONS // 2)
LAST = wp.constant(DIRECTIONS - 1)


@wp.func_native("""
    const int pitch = bits.shape[1], i = blockIdx.x * 256 + threadIdx.x;
    const int row = i / (32 * pitch), y = row - top, x = i - row * 32 * pitch - left;
    const bool inside = y >= 0 && y < mask.shape[0] && x >= 0 && x < mask.shape[1];
    const unsigned word = __ballot_sync(
        0xffffffffu, inside && mask.data[(size_t)y * mask.shape[1] + x] != 0);
    if (threadIdx.x % 32 == 0 && row < bits.shape[0]) bits.data[i / 32] = word;
""")
def pack_word(mask: wp.array2d[wp.uint8], top: int, left: int, bits: wp.array2d[wp.uint32]): ...


@wp.kernel
def pack(
    mask: wp.array2d[wp.uint8],  # (H, W)
    top: int,
    left: int,
    # outputs
    bits: wp.array2d[wp.uint32],  # (H + 2 top + 1, pitch)
):
    # One thread a pixel, one warp a word.
    pack_word(mask, top, left, bits)


@wp.kernel
def place(
    offsets: wp.array2d[int],  # (N, 2)
    top: int,
    left: int,
    bits: wp.array2d[wp.uint32],
    # outputs
    places: wp.array[wp.uint32],  # (N,)
):
    """Where the words moved by an offset begin: 27 bits for the word, 5 for the bit in it."""
    i = wp.tid()
    column = left + offsets[i, 1]
    word = (top + offsets[i, 0]) * bits.shape[1] + column // 32
    places[i] = wp.uint32(word) * wp.uint32(32) + wp.uint32(column % 32)


# A ring has eight offsets or a multiple of them. The counts of a warp's words change hands in
# shared memory: each thread has 32 pixels of one word, and writes one pixel of each of 32 words.
_RING = """
    const int columns = votes.shape[2], rows = votes.shape[1], pitch = bits.shape[1];
    const int words = (columns + 31) / 32, items = words * ((rows + 1) / 2);
    const int blocks = (items + 255) / 256, ring = blockIdx.x / blocks, lane = threadIdx.x % 32;
    const int item = (blockIdx.x - ring * blocks) * 256 + threadIdx.x;
    const bool works = item < items;
    const int row = works ? item / words * 2 : rows, word = works ? item % words : 0;
    const int first = starts.data[ring], last = starts.data[ring + 1];
    const int used = 32 - __clz(last - first);
    unsigned sums[2][20];
    #pragma unroll
    for (int p = 0; p < 20; ++p) sums[0][p] = sums[1][p] = 0;
    const auto add = [](unsigned& sum, unsigned a, unsigned b) {
        const unsigned half = sum ^ a, carry = (sum & a) | (half & b);
        sum = half ^ b;
        return carry;
    };
    if (works) {
        const unsigned* from = bits.data + (size_t)row * pitch + word;
        for (int k = first; k < last; k += 8) {
            unsigned moved[2][8];
            #pragma unroll
            for (int j = 0; j < 8; ++j) {
                const unsigned place = places.data[k + j], shift = place % 32;
                const unsigned* at = from + place / 32;
                moved[0][j] = __funnelshift_r(at[0], at[1], shift);
                moved[1][j] = __funnelshift_r(at[pitch], at[pitch + 1], shift);
            }
            #pragma unroll
            for (int r = 0; r < 2; ++r) {
                unsigned* s = sums[r];
                const unsigned* m = moved[r];
                const unsigned a = add(s[0], m[0], m[1]), b = add(s[0], m[2], m[3]);
                const unsigned c = add(s[1], a, b);
                const unsigned d = add(s[0], m[4], m[5]), e = add(s[0], m[6], m[7]);
                const unsigned f = add(s[1], d, e);
                unsigned carry = add(s[2], c, f);
                #pragma unroll
                for (int p = 3; p < 20; ++p) {
                    if (carry == 0) break;
                    const unsigned both = s[p] & carry;
                    s[p] ^= carry;
                    carry = both;
                }
            }
        }
    }
    __shared__ __align__(16) unsigned handed[256][20];
    const unsigned (*warp)[20] = handed + threadIdx.x / 32 * 32;
    for (int r = 0; r < 2; ++r) {
        __syncwarp();
        #pragma unroll
        for (int p = 0; p < 20; ++p) handed[threadIdx.x][p] = r == 0 ? sums[0][p] : sums[1][p];
        __syncwarp();
        for (int i = 0; i < 32; ++i) {
            const int y = __shfl_sync(0xffffffffu, row, i) + r;
            const int x = __shfl_sync(0xffffffffu, word, i) * 32 + lane;
            int count = 0;
            for (int p = 0; p < used; p += 4) {
                const uint4 four = *reinterpret_cast<const uint4*>(&warp[i][p]);
                count += (four.x >> lane & 1) << p | (four.y >> lane & 1) << (p + 1)
                       | (four.z >> lane & 1) << (p + 2) | (four.w >> lane & 1) << (p + 3);
            }
            if (y < rows && x < columns) {
                const wp::float32 share = (wp::float32)count / (wp::float32)(last - first);
                if (shares) count = __float_as_int(share);
                votes.data[((size_t)ring * rows + y) * columns + x] = count;
            }
        }
    }
"""


@wp.func_native(_RING)
def vote_words(
    bits: wp.array2d[wp.uint32],
    places: wp.array[wp.uint32],
    starts: wp.array[int],
    shares: bool,
    votes: wp.array3d[int],
): ...


@wp.kernel
def vote_rings(
    bits: wp.array2d[wp.uint32],  # (H + 2 top + 1, pitch)
    places: wp.array[wp.uint32],  # (N,)
    starts: wp.array[int],  # (R + 1,)
    shares: bool,
    # outputs
    votes: wp.array3d[int],  # (R, H + 2 pad, W + 2 pad), of float32 if `shares`
):
    vote_words(bits, places, starts, shares, votes)


@wp.kernel
def clear(
    # outputs
    votes: wp.array[int],
):
    votes[wp.tid()] = 0


@wp.func
def vote(votes: wp.array3d[int], ring: int, y: int, x: int):
    """Add one vote, if inside."""
    if y >= 0 and x >= 0 and y < votes.shape[1] and x < votes.shape[2]:
        wp.atomic_add(votes, ring, y, x, 1)


@wp.kernel
def vote_directed(
    points: wp.array2d[int],  # (N, 2)
    starts: wp.array[int],  # (H + 1,)
    orientation: wp.array2d[float],  # (H, W)
    radii: wp.array[int],  # (R,)
    directions: wp.array2d[int],  # (DIRECTIONS, 2)
    tolerance: int,
    offsets: wp.array2d[int],  # (M, 2)
    codes: wp.array[int],  # (M,)
    offset_starts: wp.array[int],  # (R + 1,)
    # outputs
    votes: wp.array3d[int],  # (R, H + 2 pad, W + 2 pad)
):
    # One thread a point; the host does not know how many there are.
    i = wp.tid()
    if i >= starts[starts.shape[0] - 1]:
        return
    pad = (votes.shape[2] - orientation.shape[1]) // 2
    y = points[i, 0] + pad
    x = points[i, 1] + pad
    code = direction_code(orientation[points[i, 0], points[i, 1]])
    for ring in range(votes.shape[0]):
        if tolerance < 0:
            down = (radii[ring] * directions[code, 0] + 32768) >> 16
            along = (radii[ring] * directions[code, 1] + 32768) >> 16
            vote(votes, ring, y + down, x + along)
            vote(votes, ring, y - down, x - along)
        else:
            begin = offset_starts[ring]
            size = offset_starts[ring + 1] - begin
            for side in range(2):
                least = (code + side * HALF_TURN - tolerance) & LAST
                low = int(0)  # becomes the first offset whose code is not before `least`
                high = size
                while low < high:
                    middle = (low + high) // 2
                    if codes[begin + middle] < least:
                        low = middle + 1
                    else:
                        high = middle
                for k in range(size):
                    at = begin + (low + k) % size
                    if ((codes[at] - least) & LAST) > 2 * tolerance:
                        break
                    vote(votes, ring, y + offsets[at, 0], x + offsets[at, 1])


@wp.func_native("""
    const wp::float32 share = (wp::float32)votes.data[i] / (wp::float32)size;
    votes.data[i] = __float_as_int(share);
""")
def divide(votes: wp.array[int], i: int, size: int): ...


@wp.kernel
def share(
    offset_starts: wp.array[int],  # (R + 1,)
    plane: int,
    # outputs
    votes: wp.array[int],  # (R plane,), then of float32
):
    i = wp.tid()
    ring = i // plane
    divide(votes, i, offset_starts[ring + 1] - offset_starts[ring])
