#include "_speckles_cpu.h"

void label_slab(int slab, int first, int last, wp::array_t<float> disparity, float difference,
                wp::array_t<int> labels, wp::array_t<int> parents, wp::array_t<int> sizes) {
    const Regions regions = {disparity.data, disparity.shape[1], difference,
                             labels.data,    parents.data,       sizes.data};
    for (int row = first; row < last; ++row) {
        regions.find_runs(row);
        if (row > first) regions.join_rows(row);
    }
}

void join_slabs(int slabs, wp::array_t<float> disparity, float difference, wp::array_t<int> labels,
                wp::array_t<int> parents, wp::array_t<int> sizes) {
    const Regions regions = {disparity.data, disparity.shape[1], difference,
                             labels.data,    parents.data,       sizes.data};
    for (int seam = 1; seam < slabs; ++seam)
        regions.join_rows((int)((long long)disparity.shape[0] * seam / slabs));
}

void keep_regions(int slab, int first, int last, wp::array_t<float> disparity, int min_size,
                  wp::array_t<int> labels, wp::array_t<int> parents, wp::array_t<int> sizes,
                  wp::array_t<float> kept) {
    const int columns = disparity.shape[1];
    const float none = __builtin_nanf("");
    bool large = false;
    for (int i = first * columns; i < last * columns; ++i) {
        int label = labels.data[i];
        if (label == i) {
            while (parents.data[label] != label) label = parents.data[label];
            large = sizes.data[label] >= min_size;
        }
        kept.data[i] = large ? disparity.data[i] : none;
    }
}
