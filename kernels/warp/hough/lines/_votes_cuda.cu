// needs SIZE WEIGHTED
// A block has one angle, a share of the points of an image, and SIZE bins, beginning at `low`, in
// shared memory. A thread takes four points at a time; a load of 16 bytes brings two of them. An
// image has the points of `height` rows, which are numbered through all images.
void vote(wp::array_t<int> points, wp::array_t<int> starts, wp::array_t<int> cosine,
          wp::array_t<int> sine, wp::array_t<wp::int64> offset, int shift, int parts,
          wp::array_t<int> weights, int images, wp::array_t<int> shares) {
    __shared__ int histogram[SIZE];
    const int t = threadIdx.x, threads = blockDim.x;
    const int angles = shares.shape[1], bins = shares.shape[2];
    const int angle = blockIdx.x % angles, rest = blockIdx.x / angles;
    const int low = rest % parts * SIZE, both = rest / parts, count = shares.shape[0] / images;
    const int image = both / count, share = both - image * count;
    const int height = images > 1 ? (starts.shape[0] - 1) / images : 0;
    const int width = bins - low < SIZE ? bins - low : SIZE;
    for (int i = t; i < width; i += threads) histogram[i] = 0;
    __syncthreads();
    const int first = image ? starts.data[image * height] : 0;
    const int last = starts.data[image + 1 == images ? starts.shape[0] - 1 : (image + 1) * height];
    const auto border = [&](int k) {
        const int at = (first + (int)((long long)(last - first) * k / count)) & ~1;
        return k == 0 ? first : k == count ? last : max(first, at);
    };
    const int end = border(share + 1);
    int begin = border(share);
    const long long c = cosine.data[angle], s = sine.data[angle];
    const long long o = offset.data[angle] - s * image * height - ((long long)low << shift);
    const int4* pairs = reinterpret_cast<const int4*>(points.data);
    const auto cast = [&](int j) {
        const int y = points.data[2 * j], x = points.data[2 * j + 1];
        const unsigned int at = (unsigned int)((x * c + (y * s + o)) >> shift);
        if (at < width) atomicAdd(histogram + at, WEIGHTED ? weights.data[j] : 1);
    };
    if (begin & 1) {  // a load of two points must be aligned
        if (t == 0 && begin < end) cast(begin);
        ++begin;
    }
    int i = begin + 2 * t;
    for (; i + 2 * threads + 1 < end; i += 4 * threads) {
        const int4 a = pairs[i / 2], b = pairs[i / 2 + threads];
        const unsigned int at[4] = {(unsigned int)((a.y * c + (a.x * s + o)) >> shift),
                                    (unsigned int)((a.w * c + (a.z * s + o)) >> shift),
                                    (unsigned int)((b.y * c + (b.x * s + o)) >> shift),
                                    (unsigned int)((b.w * c + (b.z * s + o)) >> shift)};
#pragma unroll
        for (int k = 0; k < 4; ++k)
            if (at[k] < width)
                atomicAdd(histogram + at[k],
                          WEIGHTED ? weights.data[i + k % 2 + 2 * threads * (k / 2)] : 1);
    }
    for (; i < end; i += 2 * threads)
        for (int j = i; j < i + 2 && j < end; ++j) cast(j);
    __syncthreads();
    int* to = shares.data + ((size_t)both * angles + angle) * bins + low;
    for (int i = t; i < width; i += threads) to[i] = histogram[i];
}

// needs TILE
// A block adds the shares of a square of TILE by TILE votes, and transposes it, so that the angles
// are along the rows. Each of its warps takes a row of the square.
void add_up(wp::array_t<int> shares, wp::array_t<int> votes) {
    __shared__ int square[TILE][TILE + 1];
    const int images = votes.shape[0], bins = votes.shape[1], angles = votes.shape[2];
    const int across = (bins + TILE - 1) / TILE, down = (angles + TILE - 1) / TILE;
    const int rest = blockIdx.x / across, image = rest / down, count = shares.shape[0] / images;
    const int bin = blockIdx.x % across * TILE, angle = rest % down * TILE;
    const int lane = threadIdx.x % 32, row = threadIdx.x / 32;
    const size_t size = (size_t)angles * bins;
    for (int k = row; k < TILE; k += 8)
        if (angle + k < angles && bin + lane < bins) {
            const int* from =
                shares.data + image * count * size + (size_t)(angle + k) * bins + bin + lane;
            int sum = 0;
            for (int share = 0; share < count; ++share) sum += from[share * size];
            square[k][lane] = sum;
        }
    __syncthreads();
    for (int k = row; k < TILE; k += 8)
        if (bin + k < bins && angle + lane < angles)
            votes.data[image * size + (size_t)(bin + k) * angles + angle + lane] = square[lane][k];
}
