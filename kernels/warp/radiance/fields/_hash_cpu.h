#include "_hash_cell.h"

// needs PRIME_Y, PRIME_Z
// Compute the features of items `first` to `last`; items are the samples of a level, level by
// level.
void look_up(int first, int last, wp::array_t<float> positions, wp::array_t<int> total,
             wp::array_t<int> resolutions, wp::array_t<int> offsets, wp::array_t<float> table,
             wp::array_t<float> features) {
#pragma clang fp contract(fast)
    const int samples = positions.shape[0], pitch = features.shape[1];
    const int known = total.data[0] < samples ? total.data[0] : samples;
    const float* at = positions.data;
    for (int level = first / samples; level * samples < last; ++level) {
        const int cells = resolutions.data[level], begins = offsets.data[level];
        const int size = offsets.data[level + 1] - begins;
        const unsigned mask = (unsigned)size - 1u;
        const int lowest = level * samples;
        const int begin = first > lowest ? first - lowest : 0;
        const int end = last - lowest < known ? last - lowest : known;
        const float* entries = table.data + 2 * (size_t)begins;
        float* to = features.data + 2 * level;
        const auto encode = [&](const auto& entry_of) {
#pragma clang loop vectorize(assume_safety)
            for (int s = begin; s < end; ++s) {
                const HashCell cell(at + 3 * s, cells);
                float x = 0.0f, y = 0.0f;
#pragma clang loop unroll(full)
                for (int corner = 0; corner < 8; ++corner) {
                    const int entry = entry_of(cell, corner);
                    const float share = cell.share(corner);
                    x += share * entries[2 * entry];
                    y += share * entries[2 * entry + 1];
                }
                to[pitch * s] = x;
                to[pitch * s + 1] = y;
            }
        };
        if ((long long)(cells + 1) * (cells + 1) * (cells + 1) <= size)
            encode([=](const HashCell& cell, int corner) { return cell.flat(corner, cells); });
        else
            encode([=](const HashCell& cell, int corner) { return cell.mixed(corner, mask); });
    }
}

// needs PRIME_Y, PRIME_Z, BATCH
// Add the gradients of levels `first` to `last`. A feature is a weighted sum of entries, so an
// entry's gradient is its weight times the feature's gradient. The corners of BATCH samples are
// found first; then their gradients are added.
void scatter(int first, int last, wp::array_t<float> positions, wp::array_t<int> total,
             wp::array_t<int> resolutions, wp::array_t<int> offsets, wp::array_t<float> d_features,
             wp::array_t<float> d_table) {
    const int samples = positions.shape[0], pitch = d_features.shape[1];
    const int known = total.data[0] < samples ? total.data[0] : samples;
    const float* at = positions.data;
    int places[8 * BATCH];
    float shares[8 * BATCH];
    for (int level = first; level < last; ++level) {
        const int cells = resolutions.data[level], begins = offsets.data[level];
        const int size = offsets.data[level + 1] - begins;
        const unsigned mask = (unsigned)size - 1u;
        float* entries = d_table.data + 2 * (size_t)begins;
        for (int start = 0; start < known; start += BATCH) {
            const int count = known - start < BATCH ? known - start : BATCH;
            const auto find = [&](const auto& entry_of) {
#pragma clang loop vectorize(assume_safety)
                for (int b = 0; b < count; ++b) {
                    const HashCell cell(at + 3 * (start + b), cells);
#pragma clang loop unroll(full)
                    for (int corner = 0; corner < 8; ++corner) {
                        places[BATCH * corner + b] = entry_of(cell, corner);
                        shares[BATCH * corner + b] = cell.share(corner);
                    }
                }
            };
            if ((long long)(cells + 1) * (cells + 1) * (cells + 1) <= size)
                find([=](const HashCell& cell, int corner) { return cell.flat(corner, cells); });
            else
                find([=](const HashCell& cell, int corner) { return cell.mixed(corner, mask); });
            for (int b = 0; b < count; ++b) {
                const float* d = d_features.data + (size_t)(start + b) * pitch + 2 * level;
                const float dx = d[0], dy = d[1];
                if (dx == 0.0f && dy == 0.0f) continue;
                for (int corner = 0; corner < 8; ++corner) {
                    float* to = entries + 2 * places[BATCH * corner + b];
                    to[0] += shares[BATCH * corner + b] * dx;
                    to[1] += shares[BATCH * corner + b] * dy;
                }
            }
        }
    }
}
