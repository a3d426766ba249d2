// needs FIRST, SIDEWAYS, MOST, TILE, TOGETHER, Path, Seen
void walk(bool active, int ray, Path path, wp::array_t<float> planes,
          wp::array_t<wp::uint32> texels, wp::array_t<wp::uint8> filled, float stop, Seen seen) {
    // A block of rays meets a list of planes: those with something in the part that its rays can
    // see. The texels of TOGETHER planes are loaded before any is used, so that loads wait together.
    __shared__ float2 at[MOST];   // inverse depths of the planes of the list, and depths
    __shared__ int places[MOST];  // their numbers
    __shared__ float boxes[32][8];
    __shared__ unsigned kept[MOST / 32];
    const int count = texels.shape[0], height = texels.shape[1], width = texels.shape[2];
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const int warps = blockDim.x >> 5;
    // A ray meets the plane of q at (x + right q, y + down q); find the bounds of all rays.
    const bool ahead = active && path.ahead > SIDEWAYS;
    const float none = __int_as_float(0x7f800000);
    float box[8] = {path.x, path.right, path.y, path.down};
#pragma unroll
    for (int n = 0; n < 4; ++n) {
        box[n + 4] = ahead ? -box[n] : none;  // the largest ones as the least of negative ones
        box[n] = ahead ? box[n] : none;
    }
#pragma unroll
    for (int n = 0; n < 8; ++n) {
#pragma unroll
        for (int step = 16; step; step >>= 1)
            box[n] = fminf(box[n], __shfl_xor_sync(0xffffffffu, box[n], step));
        if (lane == 0) boxes[warp][n] = box[n];
    }
    __syncthreads();
#pragma unroll
    for (int n = 0; n < 8; ++n) {
        for (int k = 0; k < warps; ++k) box[n] = fminf(box[n], boxes[k][n]);
    }
    const int down = filled.shape[1], across = filled.shape[2];
    for (int k = threadIdx.x; k < (count + 31 & ~31); k += blockDim.x) {
        bool some = false;
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
        }
        const unsigned all = __ballot_sync(0xffffffffu, some);
        if (lane == 0) kept[k >> 5] = all;
    }
    __syncthreads();
    int listed = 0;
    for (int word = 0; word < (count + 31) / 32; ++word) {
        const int k = 32 * word + lane;
        if (warp == word % warps && kept[word] >> lane & 1) {
            const int place = listed + __popc(kept[word] & (1u << lane) - 1);
            const float q = planes.data[FIRST + k];
            at[place] = make_float2(q, 1.0f / q);
            places[place] = k;
        }
        listed += __popc(kept[word]);
    }
    __syncthreads();
    if (!active) return;
    const unsigned even = 0x00FF00FFu;
    const float unit = 1.0f / (255.0f * 256.0f);
    const size_t area = (size_t)height * width;
    float red = 0.0f, green = 0.0f, blue = 0.0f, weight = 0.0f, far = 0.0f, through = 1.0f;
    const int end = ahead ? listed : 0;
    for (int k = 0; k < end && through > stop; k += TOGETHER) {
        unsigned corners[TOGETHER][4];
        int shares[TOGETHER][2];
#pragma unroll
        for (int n = 0; n < TOGETHER; ++n) {
            corners[n][0] = corners[n][1] = corners[n][2] = corners[n][3] = 0;
            shares[n][0] = shares[n][1] = 0;
            if (k + n < end) {
                const float q = at[k + n].x;
                float column = path.x + path.right * q, row = path.y + path.down * q;
                if (q * path.eye < 1.0f && row >= -0.5f && column >= -0.5f &&
                    row <= height - 0.5f && column <= width - 0.5f) {
                    row = fminf(fmaxf(row, 0.0f), (float)(height - 1));
                    column = fminf(fmaxf(column, 0.0f), (float)(width - 1));
                    const int i = min((int)row, height - 2), j = min((int)column, width - 2);
                    const unsigned* from = texels.data + places[k + n] * area + (i * width + j);
                    corners[n][0] = __ldg(from);
                    corners[n][1] = __ldg(from + 1);
                    corners[n][2] = __ldg(from + width);
                    corners[n][3] = __ldg(from + width + 1);
                    shares[n][0] = (int)((column - j) * 256.0f + 0.5f);
                    shares[n][1] = (int)((row - i) * 256.0f + 0.5f);
                }
            }
        }
#pragma unroll
        for (int n = 0; n < TOGETHER; ++n) {
            const unsigned* c = corners[n];
            if (through > stop && (c[0] | c[1] | c[2] | c[3])) {
                const int across = shares[n][0], along = shares[n][1];
                const unsigned both = (across * along + 128) >> 8;
                const unsigned w[4] = {256 - across - along + both, across - both, along - both,
                                       both};
                unsigned low = 0, high = 0;  // two channels each, in 16 bits
#pragma unroll
                for (int m = 0; m < 4; ++m) {
                    low += (c[m] & even) * w[m];
                    high += ((c[m] >> 8) & even) * w[m];
                }
                const float alpha = unit * (high >> 16), scale = unit * through;
                const float part = through * alpha;
                red += scale * (low & 0xFFFFu);
                green += scale * (high & 0xFFFFu);
                blue += scale * (low >> 16);
                weight += part;
                far += part * at[k + n].y;
                through *= 1.0f - alpha;
            }
        }
    }
    seen.color.data[3 * ray] = red;
    seen.color.data[3 * ray + 1] = green;
    seen.color.data[3 * ray + 2] = blue;
    seen.opacity.data[ray] = 1.0f - through;
    seen.depth.data[ray] = path.ahead > SIDEWAYS ? (far - path.eye * weight) / path.ahead : 0.0f;
}
