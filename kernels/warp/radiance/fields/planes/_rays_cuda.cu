// needs FIRST, SIDEWAYS, MOST, TILE, TOGETHER, Path, Seen
void walk(bool active, int ray, Path path, wp::array_t<float> planes,
          wp::array_t<wp::uint64> textures, wp::array_t<wp::uint8> filled, int height, int width,
          float stop, Seen seen) {
    // A block of rays meets a list of planes: those with something in the part that its rays can
    // see. The texels of TOGETHER planes are asked for before any is used.
    __shared__ float2 at[MOST];  // inverse depths of the planes of the list, and depths
    __shared__ unsigned long long images[MOST];
    __shared__ float boxes[32][8];
    __shared__ unsigned kept[MOST / 32];
    const int count = textures.shape[0], lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
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
            images[place] = textures.data[k];
        }
        listed += __popc(kept[word]);
    }
    __syncthreads();
    if (!active) return;
    float red = 0.0f, green = 0.0f, blue = 0.0f, weight = 0.0f, far = 0.0f, through = 1.0f;
    const int end = ahead ? listed : 0;
    for (int k = 0; k < end && through > stop; k += TOGETHER) {
        float4 found[TOGETHER];
#pragma unroll
        for (int n = 0; n < TOGETHER; ++n) {
            found[n] = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
            if (k + n < end) {
                const float q = at[k + n].x;
                const float column = path.x + path.right * q, row = path.y + path.down * q;
                if (q * path.eye < 1.0f && row >= -0.5f && column >= -0.5f &&
                    row <= height - 0.5f && column <= width - 0.5f)
                    asm volatile("tex.2d.v4.f32.f32 {%0, %1, %2, %3}, [%4, {%5, %6}];"
                                 : "=f"(found[n].x), "=f"(found[n].y), "=f"(found[n].z),
                                   "=f"(found[n].w)
                                 : "l"(images[k + n]), "f"(column + 0.5f), "f"(row + 0.5f));
            }
        }
#pragma unroll
        for (int n = 0; n < TOGETHER; ++n) {
            if (through > stop && found[n].w > 0.0f) {
                const float part = through * found[n].w;
                red += through * found[n].x;
                green += through * found[n].y;
                blue += through * found[n].z;
                weight += part;
                far += part * at[k + n].y;
                through -= part;
            }
        }
    }
    seen.color.data[3 * ray] = red;
    seen.color.data[3 * ray + 1] = green;
    seen.color.data[3 * ray + 2] = blue;
    seen.opacity.data[ray] = 1.0f - through;
    seen.depth.data[ray] = path.ahead > SIDEWAYS ? (far - path.eye * weight) / path.ahead : 0.0f;
}
