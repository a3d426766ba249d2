"""The set pixels of a mask on the CPU: one thread a slab of rows, eight pixels at a time."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func_native("""
    const int columns = mask.shape[1];
    const unsigned char* pixel = mask.data + (size_t)y * columns;
    int number = 0;
    #pragma clang loop vectorize(assume_safety)
    for (int x = 0; x < columns; ++x) number += pixel[x] != 0;
    starts.data[y + 1] = number;
""")
def count_row(mask: wp.array2d[wp.uint8], y: int, starts: wp.array[int]): ...


@wp.kernel
def count(
    slab: int,
    first: int,
    last: int,
    mask: wp.array2d[wp.uint8],  # (H, W)
    # outputs
    starts: wp.array[int],  # (H + 1,): for now the number in each row, one place later
):
    for y in range(first, last):
        count_row(mask, y, starts)


@wp.kernel
def add_up(
    # outputs
    starts: wp.array[int],  # (H + 1,)
):
    starts[0] = 0
    for y in range(1, starts.shape[0]):
        starts[y] = starts[y] + starts[y - 1]


@wp.func_native("""
    const int columns = mask.shape[1];
    const unsigned char* pixel = mask.data + (size_t)y * columns;
    int* next = points.data + 2 * (size_t)starts.data[y];
    int x = 0;
    for (; x + 8 <= columns; x += 8) {
        unsigned long long eight;
        __builtin_memcpy(&eight, pixel + x, 8);
        // The highest bit of every byte that is not 0.
        const unsigned long long low = 0x7f7f7f7f7f7f7f7full;
        unsigned long long set = (((eight & low) + low) | eight) & ~low;
        for (; set; set &= set - 1) {
            next[0] = y;
            next[1] = x + __builtin_ctzll(set) / 8;
            next += 2;
        }
    }
    for (; x < columns; ++x)
        if (pixel[x]) {
            next[0] = y;
            next[1] = x;
            next += 2;
        }
""")
def gather_row(
    mask: wp.array2d[wp.uint8], y: int, starts: wp.array[int], points: wp.array2d[int]
): ...


@wp.kernel
def gather(
    slab: int,
    first: int,
    last: int,
    mask: wp.array2d[wp.uint8],  # (H, W)
    starts: wp.array[int],  # (H + 1,)
    # outputs
    points: wp.array2d[int],  # (capacity, 2)
):
    for y in range(first, last):
        gather_row(mask, y, starts, points)


@wp.kernel
def first_outside(
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],  # (H + 1,)
    values: wp.array2d[float],  # (H, W)
    low: float,
    high: float,
    # outputs
    index: wp.array[int],  # (1,)
):
    number = starts[starts.shape[0] - 1]
    found = number
    for i in range(number):
        value = values[points[i, 0], points[i, 1]]
        if not (value >= low and value <= high) and found == number:
            found = i
    index[0] = found
