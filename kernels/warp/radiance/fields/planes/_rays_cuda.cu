// needs FIRST, SIDEWAYS, MOST, TOGETHER, Path, Seen
void walk(bool active, int ray, Path path, wp::array_t<float> planes,
          wp::array_t<wp::uint32> texels, float stop, Seen seen) {
    // The texels of TOGETHER planes are loaded before any is used, so that loads wait together.
    __shared__ float2 at[MOST];  // inverse depths of the planes, and depths
    const int count = texels.shape[0], height = texels.shape[1], width = texels.shape[2];
    for (int k = threadIdx.x; k < count; k += blockDim.x) {
        const float q = planes.data[FIRST + k];
        at[k] = make_float2(q, 1.0f / q);
    }
    __syncthreads();
    if (!active) return;
    const unsigned even = 0x00FF00FFu;
    const float unit = 1.0f / (255.0f * 256.0f);
    const size_t area = (size_t)height * width;
    float red = 0.0f, green = 0.0f, blue = 0.0f, weight = 0.0f, far = 0.0f, through = 1.0f;
    const unsigned* plane = texels.data;
    const int end = path.ahead > SIDEWAYS ? count : 0;
    for (int k = 0; k < end && through > stop; k += TOGETHER, plane += TOGETHER * area) {
        unsigned corners[TOGETHER][4];
        int shares[TOGETHER][2];
#pragma unroll
        for (int n = 0; n < TOGETHER; ++n) {
            corners[n][0] = corners[n][1] = corners[n][2] = corners[n][3] = 0;
            shares[n][0] = shares[n][1] = 0;
            if (k + n < count) {
                const float q = at[k + n].x;
                float column = path.x + path.right * q, row = path.y + path.down * q;
                if (q * path.eye < 1.0f && row >= -0.5f && column >= -0.5f &&
                    row <= height - 0.5f && column <= width - 0.5f) {
                    row = fminf(fmaxf(row, 0.0f), (float)(height - 1));
                    column = fminf(fmaxf(column, 0.0f), (float)(width - 1));
                    const int i = min((int)row, height - 2), j = min((int)column, width - 2);
                    const unsigned* from = plane + n * area + (i * width + j);
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
