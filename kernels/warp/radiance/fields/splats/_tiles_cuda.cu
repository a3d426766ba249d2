// needs TILE, SHOWN, FAINT, MOST, Tiles, Seen
// Composite the pixels of a tile, front to back; all threads of a block come here.
void composite_pixel(int tile, Tiles tiles, Seen seen) {
    // A warp takes 8 x 4 pixels, so that it can leave out splats that do not reach these.
    __shared__ float4 batch[TILE * TILE][SHOWN / 4];
    const int width = tiles.width, height = tiles.height;
    const float stop = tiles.stop;
    const int columns = (width + TILE - 1) / TILE, lane = threadIdx.x & 31;
    const int warp = threadIdx.x >> 5, across = tile % columns * TILE + (warp & 1) * 8;
    const int along = tile / columns * TILE + (warp >> 1) * 4;
    const int column = across + (lane & 7), row = along + (lane >> 3);
    const bool inside = column < width && row < height;
    const float middle_x = across + 3.5f, middle_y = along + 1.5f;
    float red = 0.0f, green = 0.0f, blue = 0.0f, far = 0.0f, through = inside ? 1.0f : 0.0f;
    const int end = tiles.ranges.data[tile + 1];
    for (int begin = tiles.ranges.data[tile]; begin < end; begin += TILE * TILE) {
        if (!__syncthreads_or(through > stop)) break;
        if (begin + threadIdx.x < end) {
            const float4* from =
                (const float4*)(tiles.shown.data +
                                (size_t)SHOWN * tiles.entries.data[begin + threadIdx.x]);
#pragma unroll
            for (int k = 0; k < SHOWN / 4; ++k) batch[threadIdx.x][k] = __ldg(from + k);
        }
        __syncthreads();
        const int count = min(TILE * TILE, end - begin);
        for (int first = 0; first < count; first += 32) {
            // A lane tests one splat, and the warp goes on with those that reach it.
            bool reaches = false;
            if (first + lane < count) {
                const float4 a = batch[first + lane][0], c = batch[first + lane][2];
                reaches =
                    fabsf(a.x - middle_x) <= c.z + 3.5f && fabsf(a.y - middle_y) <= c.w + 1.5f;
            }
            if (!__any_sync(0xffffffffu, through > stop)) break;
            for (unsigned left = __ballot_sync(0xffffffffu, reaches); left; left &= left - 1) {
                const int n = first + __ffs(left) - 1;
                const float4 a = batch[n][0], b = batch[n][1], c = batch[n][2];
                const float dx = a.x - column, dy = a.y - row;
                const float e = -0.5f * (a.z * dx * dx + b.x * dy * dy) - a.w * dx * dy;
                const float alpha = fminf(b.y * __expf(fminf(e, 0.0f)), MOST);
                if (alpha >= FAINT && through > stop) {
                    const float weight = through * alpha;
                    red += weight * b.z;
                    green += weight * b.w;
                    blue += weight * c.x;
                    far += weight * c.y;
                    through -= weight;
                }
            }
        }
    }
    if (!inside) return;
    const size_t ray = (size_t)row * width + column;
    seen.color.data[3 * ray] = red;
    seen.color.data[3 * ray + 1] = green;
    seen.color.data[3 * ray + 2] = blue;
    seen.opacity.data[ray] = 1.0f - through;
    seen.depth.data[ray] = far;
}

// needs TILE, SHOWN, SLOPES, FAINT, MOST, BATCH, Tiles, Seen
// Compute the gradients of the entries of a tile, front to back; all threads of a block come here.
void trace_pixel(int tile, Seen d_seen, Tiles tiles, Seen seen, wp::array_t<float> slopes) {
    // The sums over the pixels of each warp are kept for BATCH splats, then added in one order.
    __shared__ float4 batch[BATCH][SHOWN / 4];
    // BATCH is 32: a bit of `reached` says whether a warp has sums of a splat.
    __shared__ float sums[BATCH][TILE * TILE / 32][SLOPES];
    __shared__ unsigned reached[TILE * TILE / 32];
    const int width = tiles.width, height = tiles.height;
    const float stop = tiles.stop;
    const int columns = (width + TILE - 1) / TILE, lane = threadIdx.x & 31;
    const int warp = threadIdx.x >> 5, across = tile % columns * TILE + (warp & 1) * 8;
    const int along = tile / columns * TILE + (warp >> 1) * 4;
    const int column = across + (lane & 7), row = along + (lane >> 3);
    const bool inside = column < width && row < height;
    const float middle_x = across + 3.5f, middle_y = along + 1.5f;
    const size_t ray = inside ? (size_t)row * width + column : 0;
    float through = inside ? 1.0f : 0.0f, rest = 0.0f, g[4] = {0.0f, 0.0f, 0.0f, 0.0f};
    if (inside) {
        g[3] = d_seen.opacity.data[ray];
        rest = g[3] * seen.opacity.data[ray];
#pragma unroll
        for (int k = 0; k < 3; ++k) {
            g[k] = d_seen.color.data[3 * ray + k];
            rest += g[k] * seen.color.data[3 * ray + k];
        }
    }
    // Half of the lanes keep five of nine sums, half of these three, then two, then one.
    const int part = 3 * (lane >> 3 & 1) + 2 * (lane >> 2 & 1) + (lane >> 1 & 1);
    const bool mine = (lane & 1) == 0 && (lane >> 2 & 1) + (lane >> 1 & 1) < 2 && part < 5 &&
                      part + 5 * (lane >> 4) < SLOPES;
    const int number = part + 5 * (lane >> 4);
    const auto fold = [lane](float* v, const int count, const int bit) {
        const bool high = lane & bit;
#pragma unroll
        for (int k = 0; k < 5; ++k) {
            if (k >= count) continue;
            const float other = __shfl_xor_sync(0xffffffffu, high ? v[k] : v[k + count], bit);
            v[k] = (high ? v[k + count] : v[k]) + other;
        }
    };
    const int end = tiles.ranges.data[tile + 1];
    for (int begin = tiles.ranges.data[tile]; begin < end; begin += BATCH) {
        const bool alive = __syncthreads_or(through > stop);
        const int count = min(BATCH, end - begin);
        if (threadIdx.x < count) {
            const float4* from =
                (const float4*)(tiles.shown.data +
                                (size_t)SHOWN * tiles.entries.data[begin + threadIdx.x]);
#pragma unroll
            for (int k = 0; k < SHOWN / 4; ++k) batch[threadIdx.x][k] = __ldg(from + k);
        }
        __syncthreads();
        bool reaches = false;
        if (lane < count) {
            const float4 a = batch[lane][0], c = batch[lane][2];
            reaches = fabsf(a.x - middle_x) <= c.z + 3.5f && fabsf(a.y - middle_y) <= c.w + 1.5f;
        }
        const bool goes_on = alive && __any_sync(0xffffffffu, through > stop);
        unsigned seen_here = 0;
        for (unsigned left = __ballot_sync(0xffffffffu, reaches && goes_on); left;
             left &= left - 1) {
            const int n = __ffs(left) - 1;
            const float4 a = batch[n][0], b = batch[n][1], c = batch[n][2];
            const float dx = a.x - column, dy = a.y - row;
            const float e = -0.5f * (a.z * dx * dx + b.x * dy * dy) - a.w * dx * dy;
            const float alpha = fminf(b.y * __expf(fminf(e, 0.0f)), MOST);
            const bool on = alpha >= FAINT && through > stop;
            if (!__any_sync(0xffffffffu, on)) continue;
            seen_here |= 1u << n;
            float v[10] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
            if (on) {
                const float weight = through * alpha;
                const float slope = g[0] * b.z + g[1] * b.w + g[2] * c.x + g[3];
                const float left = through - weight;
                rest -= weight * slope;
                const float shadow = left > stop ? __fdividef(rest, 1.0f - alpha) : 0.0f;
                const float d = alpha < MOST ? (through * slope - shadow) * alpha : 0.0f;
                v[0] = -(a.z * dx + a.w * dy) * d;
                v[1] = -(b.x * dy + a.w * dx) * d;
                v[2] = -0.5f * dx * dx * d;
                v[3] = -dx * dy * d;
                v[4] = -0.5f * dy * dy * d;
                v[5] = d;
                v[6] = weight * g[0];
                v[7] = weight * g[1];
                v[8] = weight * g[2];
                through = left;
            }
            fold(v, 5, 16);
            v[5] = 0.0f;
            fold(v, 3, 8);
            v[3] = 0.0f;
            fold(v, 2, 4);
            fold(v, 1, 2);
            v[0] += __shfl_xor_sync(0xffffffffu, v[0], 1);
            if (mine) sums[n][warp][number] = v[0];
        }
        if (lane == 0) reached[warp] = seen_here;
        __syncthreads();
        for (int k = threadIdx.x; k < count * SLOPES; k += TILE * TILE) {
            const int n = k / SLOPES, of = k % SLOPES;
            float total = 0.0f;
#pragma unroll
            for (int w = 0; w < TILE * TILE / 32; ++w)
                total += reached[w] >> n & 1 ? sums[n][w][of] : 0.0f;
            if (of == 5) total /= batch[n][1].y;
            slopes.data[(size_t)SLOPES * tiles.sources.data[begin + n] + of] = total;
        }
    }
}
