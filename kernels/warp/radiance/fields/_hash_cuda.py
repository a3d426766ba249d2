"""Multi-resolution hash encoding on CUDA: a thread for some levels of a sample, or for one.

The samples of a level are together: those of one ray share corners. Two corners that are neighbours
along x are close in memory, be it a level that holds them all, or one whose hash has the number of
the cell along x in its last bits: 16 bytes read at a time have both of them three times in four.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.radiance import HASH_PRIMES
from cvkern.kernels.warp.radiance._fixed_point import ADD_FIXED

OPTIONS = {"enable_backward": False}

PRIME_Y, PRIME_Z = (wp.constant(wp.uint32(prime)) for prime in HASH_PRIMES)

vec16 = wp.types.vector(16, wp.float32)


@wp.struct
class Cell:
    """Where a sample is in a level."""

    i: int
    j: int
    k: int
    f: wp.vec3  # from the lower corner, in cells


@wp.func
def cell_of(positions: wp.array2d[float], sample: int, resolution: int) -> Cell:
    """Find the cell of a sample: those at 1 are in the last one."""
    cell = Cell()
    n = float(resolution)
    at = n * wp.vec3(positions[sample, 0], positions[sample, 1], positions[sample, 2])
    cell.i = wp.clamp(int(wp.floor(at[0])), 0, resolution - 1)
    cell.j = wp.clamp(int(wp.floor(at[1])), 0, resolution - 1)
    cell.k = wp.clamp(int(wp.floor(at[2])), 0, resolution - 1)
    cell.f = at - wp.vec3(float(cell.i), float(cell.j), float(cell.k))
    return cell


@wp.func
def entry_of(cell: Cell, corner: int, resolution: int, size: int) -> int:
    """Return the place in its level's table of a corner, whose bits say on which sides it is."""
    i = wp.uint32(cell.i + (corner & 1))
    j = wp.uint32(cell.j + (corner >> 1 & 1))
    k = wp.uint32(cell.k + (corner >> 2))
    side = wp.uint32(resolution + 1)
    # Both, and no branch: most of it is the same for all eight corners. Where the first does not
    # fit 32 bits, it is not the one.
    flat = (k * side + j) * side + i
    mixed = (i ^ j * PRIME_Y ^ k * PRIME_Z) & wp.uint32(size - 1)
    cube = wp.int64(side) * wp.int64(side) * wp.int64(side)
    return int(wp.where(cube <= wp.int64(size), flat, mixed))


@wp.func
def share_of(cell: Cell, corner: int) -> float:
    """Return the weight of a corner."""
    x = wp.where((corner & 1) != 0, cell.f[0], 1.0 - cell.f[0])
    y = wp.where((corner & 2) != 0, cell.f[1], 1.0 - cell.f[1])
    z = wp.where((corner & 4) != 0, cell.f[2], 1.0 - cell.f[2])
    return x * y * z


_TWO = {
    wp.float16: """
        const unsigned int a = low, b = high;
        const uint4 near = __ldg((const uint4*)table.data + a / 4);
        auto pick = [&](unsigned int n) {
            return n & 2 ? (n & 1 ? near.w : near.z) : (n & 1 ? near.y : near.x);
        };
        unsigned int found[2] = {pick(a), pick(b)};
        if (a / 4 != b / 4) found[1] = __ldg((const unsigned int*)table.data + b);
        wp::vec_t<4, float> numbers;
        #pragma unroll
        for (int n = 0; n < 4; ++n) {
            wp::half number;
            number.u = found[n / 2] >> 16 * (n % 2);
            numbers[n] = wp::half_to_float(number);
        }
        return numbers;
    """,
    wp.float32: """
        const unsigned int a = low, b = high;
        const float4 near = __ldg((const float4*)table.data + a / 2);
        const float2 here = {a & 1 ? near.z : near.x, a & 1 ? near.w : near.y};
        float2 next = {b & 1 ? near.z : near.x, b & 1 ? near.w : near.y};
        if (a / 2 != b / 2) next = __ldg((const float2*)table.data + b);
        return wp::vec_t<4, float>(here.x, here.y, next.x, next.y);
    """,
}


_STORE = """
    constexpr int COUNT = sizeof(numbers) / sizeof(WORD);
    WORD words[COUNT];
    memcpy(words, &numbers, sizeof(numbers));
    WORD* to = (WORD*)(features.data + (size_t)sample * features.shape[1]) + group * COUNT;
    #pragma unroll
    for (int i = 0; i < COUNT; ++i) to[i] = words[i];
"""


@cache
def encode(scalar: Any, together: int) -> wp.Kernel:
    """Return the kernel that looks up features of a precision, of so many levels in a thread.

    What it writes to a row of features lies side by side: several levels fill sectors of memory.
    """
    pair, row = wp.types.vector(2, scalar), wp.types.vector(2 * together, scalar)

    @wp.func_native(_TWO[scalar])
    def two(table: wp.array[pair], low: int, high: int) -> wp.vec4: ...

    size = 2 * together * wp.types.type_size_in_bytes(scalar)
    word = {4: "unsigned int", 8: "uint2"}.get(size, "uint4")

    @wp.func_native(_STORE.replace("WORD", word))
    def store(features: wp.array2d[scalar], sample: int, group: int, numbers: row): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def encode(
        positions: wp.array2d[float],  # (M, 3), in [0, 1]
        total: wp.array[int],  # (1,)
        resolutions: wp.array[int],  # (L,)
        offsets: wp.array[int],  # (L + 1,)
        table: wp.array[pair],  # (entries,)
        # outputs
        features: wp.array2d[scalar],  # (M, 2 L)
    ):
        item = wp.tid()
        group = item // positions.shape[0]
        sample = item - group * positions.shape[0]
        if sample < total[0]:
            numbers = row()
            for n in range(together):
                level = group * together + n
                resolution = resolutions[level]
                begin = offsets[level]
                size = offsets[level + 1] - begin
                cell = cell_of(positions, sample, resolution)
                found = wp.vec2()
                for corner in range(0, 8, 2):
                    low = begin + entry_of(cell, corner, resolution, size)
                    high = begin + entry_of(cell, corner + 1, resolution, size)
                    near = two(table, low, high)
                    found += share_of(cell, corner) * wp.vec2(near[0], near[1])
                    found += share_of(cell, corner + 1) * wp.vec2(near[2], near[3])
                numbers[2 * n] = scalar(found[0])
                numbers[2 * n + 1] = scalar(found[1])
            store(features, sample, group, numbers)

    return encode


@wp.func_native("""
    const long long before = __shfl_up_sync(0xffffffffu, key, 1);
    return (threadIdx.x & 31) == 0 || key != before;
""")
def begins_run(key: wp.int64) -> bool:
    """Tell whether the lane before this one has another key; for a whole warp."""
    ...


# After n steps, a lane has the sum over itself and the 2^n - 1 lanes behind it that are of its run.
RUN_TEXT = """
    const int lane = threadIdx.x & 31;
    const unsigned int behind = __ballot_sync(0xffffffffu, begins) & 0xfffffffeu << lane;
    const int end = behind ? __ffs(behind) - 1 : 32;
    wp::vec_t<16, float> sums = values;
    for (int step = 1; __any_sync(0xffffffffu, lane + step < end); step *= 2)
        #pragma unroll
        for (int i = 0; i < 16; ++i) {
            const float more = __shfl_down_sync(0xffffffffu, sums[i], step);
            if (lane + step < end) sums[i] += more;
        }
    return sums;
"""


@wp.func_native(RUN_TEXT)
def add_up_run(begins: bool, values: vec16) -> vec16:
    """Return in the lane that begins a run the sums over its lanes; for a whole warp."""
    ...


@wp.func_native("""
    float* numbers = (float*)table.data;
#if __CUDA_ARCH__ >= 900
    if ((low ^ high) == 1) {
        const bool turned = high < low;
        const float a = turned ? z : x, b = turned ? w : y, c = turned ? x : z, d = turned ? y : w;
        float* to = numbers + 2 * (size_t)(turned ? high : low);
        asm volatile("red.global.add.v4.f32 [%0], {%1, %2, %3, %4};"
            ::"l"(to), "f"(a), "f"(b), "f"(c), "f"(d) : "memory");
        return;
    }
    float* first = numbers + 2 * (size_t)low;
    float* second = numbers + 2 * (size_t)high;
    asm volatile("red.global.add.v2.f32 [%0], {%1, %2};" ::"l"(first), "f"(x), "f"(y) : "memory");
    asm volatile("red.global.add.v2.f32 [%0], {%1, %2};" ::"l"(second), "f"(z), "f"(w) : "memory");
#else
    atomicAdd(numbers + 2 * (size_t)low, x);
    atomicAdd(numbers + 2 * (size_t)low + 1, y);
    atomicAdd(numbers + 2 * (size_t)high, z);
    atomicAdd(numbers + 2 * (size_t)high + 1, w);
#endif
""")
def add_two(table: wp.array[wp.vec2], low: int, high: int, x: float, y: float, z: float, w: float):
    """Add to two entries atomically, by as many numbers at a time as the GPU can."""
    ...


@wp.func_native(f"""
    auto add = [](wp::int64* to, float value) {{ {ADD_FIXED} }};
    add(table.data + 2 * (size_t)low, x);
    add(table.data + 2 * (size_t)low + 1, y);
    add(table.data + 2 * (size_t)high, z);
    add(table.data + 2 * (size_t)high + 1, w);
""")
def add_two_fixed(
    table: wp.array2d[wp.int64], low: int, high: int, x: float, y: float, z: float, w: float
):
    """Add to two entries of fixed-point numbers: these have the same sum in any order."""
    ...


@cache
def backward(scalar: Any, sums: Any) -> wp.Kernel:
    """Return the kernel that takes gradients of features of a precision to the table.

    That is of float32, or of int64 for fixed-point numbers. The gradients of samples side by side
    in one cell are added up first. It is for whole blocks of threads, more than samples and levels
    if need be.
    """
    pair = wp.types.vector(2, scalar)
    exact = sums is wp.int64
    table = wp.array2d[sums] if exact else wp.array[wp.vec2]
    add = add_two_fixed if exact else add_two

    @wp.kernel(module="unique", module_options=OPTIONS)
    def backward(
        positions: wp.array2d[float],  # (M, 3)
        total: wp.array[int],  # (1,)
        resolutions: wp.array[int],  # (L,)
        offsets: wp.array[int],  # (L + 1,)
        d_features: wp.array2d[pair],  # (M, L)
        # outputs
        d_table: table,  # (entries,) pairs, or (entries, 2): added to
    ):
        # A feature is a weighted sum of entries: an entry's gradient is its weight times that.
        item = wp.tid()
        level = item // positions.shape[0]
        sample = item - level * positions.shape[0]
        key = wp.int64(-1)  # of those that have no gradient
        cell = Cell()
        values = vec16()
        if level < resolutions.shape[0] and sample < total[0]:
            d = d_features[sample, level]
            dx = float(d[0])
            dy = float(d[1])
            if dx != 0.0 or dy != 0.0:
                cell = cell_of(positions, sample, resolutions[level])
                # Up to 2^20 cells along each side; two levels side by side in a warp differ by 1.
                place = wp.int64(cell.k) | wp.int64(level & 1) << wp.int64(20)
                place = wp.int64(cell.j) | place << wp.int64(20)
                key = wp.int64(cell.i) | place << wp.int64(20)
                for corner in range(8):
                    share = share_of(cell, corner)
                    values[2 * corner] = share * dx
                    values[2 * corner + 1] = share * dy
        begins = begins_run(key)
        values = add_up_run(begins, values)
        if begins and key >= wp.int64(0):
            resolution = resolutions[level]
            begin = offsets[level]
            size = offsets[level + 1] - begin
            for corner in range(0, 8, 2):
                low = begin + entry_of(cell, corner, resolution, size)
                high = begin + entry_of(cell, corner + 1, resolution, size)
                at = 2 * corner
                add(d_table, low, high, values[at], values[at + 1], values[at + 2], values[at + 3])

    return backward
