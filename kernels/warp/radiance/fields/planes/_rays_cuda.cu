#include "_samples.cu"

// needs FIRST, SIDEWAYS, MOST, TILE, TOGETHER, Path, Seen
void walk(bool active, int ray, Path path, wp::array_t<float> planes,
          wp::array_t<wp::uint32> texels, wp::array_t<wp::uint8> filled, wp::uint64 sheet,
          int columns, float stop, Seen seen) {
    // A block of rays meets a list of planes: those with something in the part that its rays can
    // see. If all its rays meet TOGETHER planes away from their borders, the units for textures
    // interpolate in them, else integer products do.
    __shared__ float4 at[MOST + TOGETHER];        // inverse depths, depths, and places in the sheet
    __shared__ unsigned firsts[MOST + TOGETHER];  // bytes, for places that count from ORIGIN
    __shared__ __align__(4) bool inner[MOST + TOGETHER];
    __shared__ float boxes[32][9];
    __shared__ unsigned kept[2][MOST / 32];
    const unsigned ORIGIN = 0x474000u;  // bits of 1.5 * 2^15, where a unit is 2^8 of the lowest
    const int count = texels.shape[0], height = texels.shape[1], width = texels.shape[2];
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const int warps = blockDim.x >> 5;
    // A ray meets the plane of q at (x + right q, y + down q); find the bounds of all rays.
    const bool ahead = active && path.ahead > SIDEWAYS;
    const float none = __int_as_float(0x7f800000);
    float box[9] = {path.x, path.right, path.y, path.down};
#pragma unroll
    for (int n = 0; n < 4; ++n) {
        box[n + 4] = ahead ? -box[n] : none;  // the largest ones as the least of negative ones
        box[n] = ahead ? box[n] : none;
    }
    box[8] = ahead ? -path.eye : none;
#pragma unroll
    for (int n = 0; n < 9; ++n) {
#pragma unroll
        for (int step = 16; step; step >>= 1)
            box[n] = fminf(box[n], __shfl_xor_sync(0xffffffffu, box[n], step));
        if (lane == 0) boxes[warp][n] = box[n];
    }
    __syncthreads();
#pragma unroll
    for (int n = 0; n < 9; ++n) {
        for (int k = 0; k < warps; ++k) box[n] = fminf(box[n], boxes[k][n]);
    }
    const int down = filled.shape[1], across = filled.shape[2];
    for (int k = threadIdx.x; k < (count + 31 & ~31); k += blockDim.x) {
        bool some = false, within = false;
        if (k < count) {
            // One texel more on each side allows for roundings.
            const float q = planes.data[FIRST + k];
            const float left = box[0] + box[1] * q - 1.0f, right = -(box[4] + box[5] * q) + 1.0f;
            const float top = box[2] + box[3] * q - 1.0f, bottom = -(box[6] + box[7] * q) + 1.0f;
            if (right > -1.0f && bottom > -1.0f && left < width && top < height) {
                const int j0 = (int)fmaxf(left, 0.0f) / TILE, i0 = (int)fmaxf(top, 0.0f) / TILE;
                const int j1 = (int)fminf(right, width - 1.0f) / TILE;
                const int i1 = (int)fminf(bottom, height - 1.0f) / TILE;
                for (int i = i0; i <= i1 && !some; ++i)
                    for (int j = j0; j <= j1 && !some; ++j)
                        some = filled.data[((size_t)k * down + i) * across + j];
            }
            within = left >= 0.0f && top >= 0.0f && right <= width - 1.0f &&
                     bottom <= height - 1.0f && -box[8] * q < 1.0f;
        }
        const unsigned all = __ballot_sync(0xffffffffu, some);
        const unsigned whole = __ballot_sync(0xffffffffu, within);
        if (lane == 0) kept[0][k >> 5] = all, kept[1][k >> 5] = whole;
    }
    __syncthreads();
    const unsigned area = (unsigned)height * width;
    int listed = 0;
    for (int word = 0; word < (count + 31) / 32; ++word) {
        const int k = 32 * word + lane;
        const unsigned all = kept[0][word];
        if (warp == word % warps && all >> lane & 1) {
            const int place = listed + __popc(all & (1u << lane) - 1);
            const float q = planes.data[FIRST + k];
            at[place] =
                make_float4(q, 1.0f / q, k % columns * width + 0.5f, k / columns * height + 0.5f);
            firsts[place] = 4u * (k * area - ORIGIN * width - ORIGIN);
            inner[place] = kept[1][word] >> lane & 1;
        }
        listed += __popc(all);
    }
    for (int k = listed + threadIdx.x; k < listed + TOGETHER; k += blockDim.x) {
        at[k] = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
        inner[k] = 0;
    }
    __syncthreads();
    if (!active) return;
    const char* words = (const char*)texels.data;
    const float unit = 1.0f / (255.0f * 256.0f), start = 49152.0f;
    Walked w = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 1.0f};
    const int end = ahead ? listed : 0;
    for (int k = 0; k < end && w.through > stop; k += TOGETHER) {
        bool whole = true;
#pragma unroll
        for (int n = 0; n < TOGETHER; n += 4)
            whole = whole && *(const unsigned*)(inner + k + n) == 0x01010101u;
        // All loads come first, so that they wait together.
        if (whole) {
            float found[TOGETHER][4];
#pragma unroll
            for (int n = 0; n < TOGETHER; ++n) {
                const float4 place = at[k + n];
                const float column = path.x + path.right * place.x + place.z;
                const float row = path.y + path.down * place.x + place.w;
                asm volatile("tex.2d.v4.f32.f32 {%0, %1, %2, %3}, [%4, {%5, %6}];"
                             : "=f"(found[n][0]), "=f"(found[n][1]), "=f"(found[n][2]),
                               "=f"(found[n][3])
                             : "l"(sheet), "f"(column), "f"(row));
            }
#pragma unroll
            for (int n = 0; n < TOGETHER; ++n) w.over(found[n], 1.0f, at[k + n].y, stop);
            continue;
        }
#pragma unroll 1
        for (int first = k; first < k + TOGETHER; first += 4) {
            unsigned corners[4][4], x[4], y[4];
#pragma unroll
            for (int n = 0; n < 4; ++n) {
                const float4 place = at[first + n];
                float column = path.x + path.right * place.x;
                float row = path.y + path.down * place.x;
                const bool inside = first + n < end && place.x * path.eye < 1.0f && row >= -0.5f &&
                                    column >= -0.5f && row <= height - 0.5f &&
                                    column <= width - 0.5f;
                row = fminf(fmaxf(row, 0.0f), height - 1.0f);
                column = fminf(fmaxf(column, 0.0f), width - 1.0f);
                x[n] = __float_as_uint(column + start);
                y[n] = __float_as_uint(row + start);
                const unsigned i = min(y[n] >> 8, ORIGIN + height - 2);
                const unsigned j = min(x[n] >> 8, ORIGIN + width - 2);
                x[n] -= j << 8;
                y[n] -= i << 8;
                const unsigned from = 4u * (i * width + j) + firsts[first + n];
                const unsigned under = from + 4u * width;
#pragma unroll
                for (int m = 0; m < 4; ++m) corners[n][m] = 0;
                if (inside) {
                    corners[n][0] = __ldg((const unsigned*)(words + from));
                    corners[n][1] = __ldg((const unsigned*)(words + (size_t)from + 4));
                    corners[n][2] = __ldg((const unsigned*)(words + under));
                    corners[n][3] = __ldg((const unsigned*)(words + (size_t)under + 4));
                }
            }
#pragma unroll
            for (int n = 0; n < 4; ++n) {
                float found[4];
                Walked::between(corners[n], x[n], y[n], found);
                w.over(found, unit, at[first + n].y, stop);
            }
        }
    }
    seen.color.data[3 * ray] = w.red;
    seen.color.data[3 * ray + 1] = w.green;
    seen.color.data[3 * ray + 2] = w.blue;
    seen.opacity.data[ray] = 1.0f - w.through;
    seen.depth.data[ray] =
        path.ahead > SIDEWAYS ? (w.far - path.eye * w.weight) / path.ahead : 0.0f;
}
