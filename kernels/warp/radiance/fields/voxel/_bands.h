#include "../../_harmonics.h"
#pragma once

// Harmonics of a ray's direction, at the places of each channel's coefficients, in rows of WIDTH.
struct VoxelBands {
    float of[3][WIDTH];

    VoxelBands(const float* direction, int basis) {
        float h[16];
        Harmonics::write(direction[0], direction[1], direction[2], h);
        for (int c = 0; c < 3; ++c) {
            for (int k = 0; k < WIDTH; ++k) of[c][k] = 0.0f;
            for (int k = 0; k < basis; ++k) of[c][c * basis + k] = h[k];
        }
    }

    // Round two of the nine as the walks do, so that results stay equal from release to release.
    void round_as_walks(const float* direction) {
#pragma clang fp contract(fast)
#pragma clang fp reassociate(on)
        const float x = direction[0], y = direction[1], z = direction[2];
        for (int c = 0; c < 3; ++c) {
            of[c][c * 9 + 6] = 0.31539156525252005f * (3.0f * z * z - 1.0f);
            of[c][c * 9 + 8] = 0.5462742152960396f * __builtin_fmaf(-y, y, x * x);
        }
    }
};
