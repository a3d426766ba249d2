// Robust rules of photometric stereo on CUDA. The values of a pixel stay in shared memory, where
// each thread has a column.
// needs KEPT, LEFT_OUT
void rank_kept(wp::array_t<float> images, wp::array_t<float> scales, wp::array_t<wp::uint8> mask,
               float limit, wp::array_t<wp::uint16> ranks) {
    enum { MANY = 8 };  // values that are compared with all others at once
    __shared__ float kept[KEPT];
    const int count = images.shape[0], threads = blockDim.x;
    const size_t plane = (size_t)images.shape[1] * images.shape[2];
    const size_t here = (size_t)blockIdx.x * threads + threadIdx.x;
    if (here >= plane) return;
    const bool inside = mask.shape[0] == 0 || mask.data[here];
    const float none = __int_as_float(0x7fc00000);  // in no order to any other
    float* own = kept + threadIdx.x;
#pragma unroll 8
    for (int k = 0; k < count; ++k) {
        const float value = __ldg(images.data + k * plane + here);
        const bool finite = fabsf(value) < __int_as_float(0x7f800000);
        own[k * threads] = inside && finite && value < limit ? value * scales.data[k] : none;
    }
    for (int first = 0; first < count; first += MANY) {
        float values[MANY], below[MANY];  // floats: comparisons keep the units of integers busy
#pragma unroll
        for (int n = 0; n < MANY; ++n) {
            values[n] = first + n < count ? own[(first + n) * threads] : none;
            below[n] = 0.0f;
        }
        for (int j = 0; j < first; ++j) {
            const float other = own[j * threads];
#pragma unroll
            for (int n = 0; n < MANY; ++n) below[n] += other <= values[n] ? 1.0f : 0.0f;
        }
        for (int j = first + MANY; j < count; ++j) {
            const float other = own[j * threads];
#pragma unroll
            for (int n = 0; n < MANY; ++n) below[n] += other < values[n] ? 1.0f : 0.0f;
        }
#pragma unroll
        for (int n = 0; n < MANY; ++n) {
            if (first + n >= count) continue;
#pragma unroll
            for (int m = 0; m < MANY; ++m)
                below[n] += (m < n ? values[m] <= values[n] : values[m] < values[n]) ? 1.0f : 0.0f;
            const bool left_out = !(values[n] == values[n]);
            ranks.data[(first + n) * plane + here] =
                (unsigned short)(left_out ? LEFT_OUT : (int)below[n]);
        }
    }
}

// Consensus, least absolute residuals, or least squares of a window of ranks. The values of a pixel
// are kept in the order of their ranks, so that a window is a part of them. Sums are float32. Each
// solution but the first is the last one and a correction, which follows from what that leaves: so
// rounding hardly counts.
// needs KEPT, LEFT_OUT, MOST, RIDGE, FLOOR, L1, CONSENSUS
void weigh_kept(wp::array_t<float> images, wp::array_t<wp::uint16> ranks, wp::array_t<float> lights,
                wp::array_t<float> windows, int method, int sweeps, wp::array_t<float> normals,
                wp::array_t<float> albedo, wp::array_t<float> residual) {
    enum { AHEAD = 4 };
    __shared__ float kept[KEPT];
    __shared__ unsigned char order[KEPT];
    __shared__ float4 lamps[MOST];
    const int count = images.shape[0], threads = blockDim.x;
    for (int k = threadIdx.x; k < count; k += threads) {
        const float* light = lights.data + 5 * k;
        lamps[k] = make_float4(light[0], light[1], light[2], light[4]);
    }
    __syncthreads();
    const size_t plane = (size_t)images.shape[1] * images.shape[2];
    const size_t here = (size_t)blockIdx.x * threads + threadIdx.x;
    if (here >= plane) return;
    float* own = kept + threadIdx.x;
    unsigned char* image = order + threadIdx.x;  // the image of each value
    int number = 0, dark = 0;  // images that count, and those of them that are not above 0
    float brightest = 0.0f;
#pragma unroll 8
    for (int k = 0; k < count; ++k) {
        const float value = __ldg(images.data + k * plane + here) * lamps[k].w;
        const int r = __ldg(ranks.data + k * plane + here);
        if (r == LEFT_OUT) continue;
        own[r * threads] = value, image[r * threads] = k;
        ++number;
        dark += !(value > 0.0f);
        brightest = fmaxf(brightest, value);
    }
    const bool found = number >= 3 && brightest > 0.0f;
    double mean[3] = {0.0, 0.0, 0.0}, strength = 0.0, total = 0.0;
    for (int m = 0; found && m < windows.shape[0]; ++m) {
        int low = (int)floorf(windows.data[2 * m] * (float)number + 0.5f);
        int high = (int)floorf(windows.data[2 * m + 1] * (float)number + 0.5f);
        // Ranks run from 0 to the number. The darkest do not count for a consensus, unless fewer
        // than three are left.
        const int least = method == CONSENSUS && number - dark >= 3 ? dark : 0;
        if (high - max(low, least) < 4) {  // too few to tell their spread
            low = 0;
            high = number;
        }
        low = max(low, least);
        double s[3] = {0.0, 0.0, 0.0}, spread = 0.0, turn = 0.0;
        // A rule of one sweep has a second one, for its correction.
        const int last = sweeps > 0 ? sweeps : 1;
        for (int sweep = 0; sweep <= last; ++sweep) {
            const float x = (float)s[0], y = (float)s[1], z = (float)s[2];
            const float scale = spread > 0.0 ? (float)(1.0 / spread) : 0.0f;
            float xx = 0.0f, xy = 0.0f, xz = 0.0f, yy = 0.0f, yz = 0.0f, zz = 0.0f;
            float bx = 0.0f, by = 0.0f, bz = 0.0f, squares = 0.0f, weights = 0.0f;
            // AHEAD values and their lights are read before the first of them is weighed, so that
            // they are waited for once. Those beyond the window weigh nothing.
            const auto gather = [&](const auto& weigh) {
#pragma unroll 1
                for (int first = low; first < high; first += AHEAD) {
                    float values[AHEAD];
                    float4 light[AHEAD];
                    int at[AHEAD];
#pragma unroll
                    for (int n = 0; n < AHEAD; ++n) {
                        const int k = min(first + n, high - 1) * threads;
                        at[n] = image[k];
                        values[n] = own[k];
                    }
#pragma unroll
                    for (int n = 0; n < AHEAD; ++n) light[n] = lamps[at[n]];
#pragma unroll
                    for (int n = 0; n < AHEAD; ++n) {
                        const float lx = light[n].x, ly = light[n].y, lz = light[n].z;
                        const float shown = lx * x + ly * y + lz * z;
                        const float off = values[n] - shown;
                        const float own_weight = weigh(shown, off);
                        const float weight = first + n < high ? own_weight : 0.0f;
                        const float wx = weight * lx, wy = weight * ly, wz = weight * lz;
                        xx += wx * lx;
                        xy += wx * ly;
                        xz += wx * lz;
                        yy += wy * ly;
                        yz += wy * lz;
                        zz += wz * lz;
                        bx += wx * off;
                        by += wy * off;
                        bz += wz * off;
                        squares += weight * off * off;
                        weights += weight;
                    }
                }
            };
            const bool weighs = sweep > 0 && scale > 0.0f;
            if (weighs && method == CONSENSUS)
                gather([=](float shown, float off) {
                    const float ratio = fabsf(off) * scale;
                    const float near = __fdividef(1.0f, 1.0f + ratio * ratio);
                    return (shown > 0.0f ? near : 0.0f) + (float)FLOOR;
                });
            else if (weighs && method == L1)
                gather([=](float shown, float off) {
                    return __fdividef(1.0f, fmaxf(fabsf(off) * scale, 1e-3f));
                });
            else
                gather([](float shown, float off) { return 1.0f; });
            // The inverse of the matrix and the ridge, by cofactors.
            const double ridge = RIDGE * ((double)xx + yy + zz);
            const double a = xx + ridge, b = xy, c = xz, d = yy + ridge, e = yz, f = zz + ridge;
            const double i = d * f - e * e, j = c * e - b * f, k = b * e - c * d;
            const double whole = 1.0 / (a * i + b * j + c * k);
            const double ii = i * whole, ij = j * whole, ik = k * whole;
            const double jj = (a * f - c * c) * whole, jk = (b * c - a * e) * whole;
            const double kk = (a * d - b * b) * whole;
            const double p = bx - ridge * x, q = by - ridge * y, r = bz - ridge * z;
            const double dx = ii * p + ij * q + ik * r, dy = ij * p + jj * q + jk * r;
            const double dz = ik * p + jk * q + kk * r;
            // What is left after the correction.
            const double bent = dx * (xx * dx + 2.0 * (xy * dy + xz * dz)) +
                                dy * (yy * dy + 2.0 * yz * dz) + zz * dz * dz;
            const double left = squares - 2.0 * (dx * bx + dy * by + dz * bz) + bent;
            s[0] = x + dx;
            s[1] = y + dy;
            s[2] = z + dz;
            spread = sqrt(fmax(left, 0.0) / fmax(weights - 3.0, 0.5));
            const double power = s[0] * s[0] + s[1] * s[1] + s[2] * s[2];
            if (power > 0.0) {
                const double along = s[0] * (ii * s[0] + ij * s[1] + ik * s[2]) +
                                     s[1] * (ij * s[0] + jj * s[1] + jk * s[2]) +
                                     s[2] * (ik * s[0] + jk * s[1] + kk * s[2]);
                turn = (ii + jj + kk - along / power) / power;
            }
        }
        const double length = sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]);
        if (!(length > 0.0 && length < 1e300)) continue;
        double share = 1.0;
        if (windows.shape[0] > 1) share = 1.0 / (spread * sqrt(fmax(turn, 0.0)) + 1e-6);
        for (int n = 0; n < 3; ++n) mean[n] += share / length * s[n];
        strength += share * length;
        total += share;
    }
    const double length = sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]);
    const bool told = found && length > 0.0;
    const float none = __int_as_float(0x7fc00000);
    const float shown[3] = {(float)(mean[0] / length), (float)(mean[1] / length),
                            (float)(mean[2] / length)};
    const float bright = told ? (float)(strength / total) : 0.0f;
    for (int n = 0; n < 3; ++n) normals.data[3 * here + n] = told ? shown[n] : none;
    albedo.data[here] = bright;
    float squares = 0.0f;
#pragma unroll 4
    for (int k = 0; k < (told ? number : 0); ++k) {
        const float4 light = lamps[image[k * threads]];
        const float model = bright * (light.x * shown[0] + light.y * shown[1] + light.z * shown[2]);
        const float off = __fdividef(own[k * threads] - fmaxf(model, 0.0f), light.w);
        squares += off * off;
    }
    residual.data[here] = told ? sqrtf(squares / (float)number) : 0.0f;
}
