#include "_sums_cpu.h"

// needs OUT
void window_costs(int slab, int first, int last, wp::array_t<ELEMENT> left,
                  wp::array_t<ELEMENT> right, Windows windows, wp::array_t<PIXEL> lines,
                  wp::array_t<SUM> columns, wp::array_t<OUT> costs) {
    typedef OUT outs
        __attribute__((vector_size(LANES * sizeof(OUT)), aligned(sizeof(OUT)), may_alias));
    const int width = left.shape[1], count = costs.shape[2];
    const WindowRow row = {(const ELEMENT*)left.data,
                           (const ELEMENT*)right.data,
                           left.shape[0],
                           width,
                           left.shape[2],
                           windows.octets,
                           windows.first,
                           count,
                           windows.radius_y,
                           windows.radius_x,
                           lines.data + (size_t)slab * lines.shape[1],
                           columns.data + (size_t)slab * columns.shape[1]};
    OUT* const out = costs.data;
    const int reach = 2 * windows.radius_x;
    for (int y = first; y < last; ++y) {
        const auto store = [=](WindowRow::sums total, int x,
                               int chunk) __attribute__((always_inline)) {
            const outs value = __builtin_convertvector(total, outs);
            OUT* const to = out + ((size_t)y * width + x - reach) * count + chunk;
            if (chunk + LANES <= count)
                *(outs*)to = value;
            else
                for (int k = 0; chunk + k < count; ++k) to[k] = value[k];
        };
        sum_windows(row, y, y == first, store);
    }
}
